"""Runs lives of a log again and says what came of it, for ``trill replay``."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.table import Table

from common.errors import ConfigError, TrillError
from common.runtime.replay.result import Report
from common.runtime.replay.runs import ServiceRun
from lab.logs.replay_check import Checker, CheckOptions, chosen, runs_in


def check(path: Path, options: CheckOptions) -> int:
    """Replay what is asked for and report each life; returns the worst exit code.

    Raises:
        TrillError: nothing of it can be replayed, or the log cannot be read.
    """
    if options.settings and len(options.services) != 1:
        raise ConfigError("--set needs exactly one --service, whose settings it changes")
    picked = chosen(runs_in(path), options.services, options.life)
    if not picked:
        raise ConfigError("nothing in the log can be replayed; --list says why")
    checker = Checker(path, options)
    codes = []
    for life in picked:
        try:
            report = _replayed(checker, life)
        except TrillError as error:
            print(f"{life.service}, life {life.number}: {error}", file=sys.stderr)
            codes.append(2)
            continue
        print("\n".join(report_lines(report, verbose=options.verbose)))
        codes.append(0 if report.identical else 1)
    if options.out is not None:
        print(f"{checker.write()} messages written to {options.out}")
    # Differing says more than not checked.
    return 1 if 1 in codes else max(codes)


def _replayed(checker: Checker, life: ServiceRun) -> Report:
    with _bar() as bar:
        task = bar.add_task(f"{life.service}, life {life.number}", total=life.length)

        def show(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total)

        return checker.check(life, show)


def report_lines(report: Report, *, verbose: bool = False) -> list[str]:
    """A replay's report for a person, line by line."""
    speed = report.replayed / report.wall if report.wall else 0.0
    lines = [
        f"{report.service}, life {report.life}: {report.steps} steps, {report.replayed:.1f} s of "
        f"recording in {report.wall:.1f} s ({speed:.1f} x real time), {report.inputs} messages fed"
    ]
    for topic, tally in sorted(report.outputs.items()):
        counts = {
            "within tolerance": tally.close,
            "differing": tally.differing,
            "missing": tally.missing,
            "extra": tally.extra,
            "not recorded": tally.unrecorded,
        }
        others = "".join(f", {count} {what}" for what, count in counts.items() if count)
        lines.append(f"  {topic:<16} {tally.compared:6d} compared, {tally.equal} equal{others}")
    if report.failure and not report.stopped:
        lines.append(f"  it failed as it did then: {report.failure}")
    lines += _difference_lines(report)
    if verbose and report.worst:
        lines.append("  largest relative difference by field:")
        ordered = sorted(report.worst.items(), key=lambda item: -item[1])
        lines += [f"    {name:<40} {value:.3g}" for name, value in ordered]
    if report.stopped:
        lines.append(f"  ended early: {report.stopped}")
    if report.identical:
        close = sum(tally.close for tally in report.outputs.values())
        lines.append("  IDENTICAL to the byte" if not close else "  EQUAL within the tolerance")
    elif report.first is not None:
        lines.append("  DIFFERENT")
    else:
        lines.append("  NOT PROVEN" if report.compared else "  NOTHING to compare")
    return lines


def _difference_lines(report: Report) -> list[str]:
    first = report.first
    if first is None:
        return []
    what = {"differs": "differs", "missing": "was recorded but not said again"}
    lines = [
        f"  first difference at step {first.step} (clock {1e-9 * first.now_ns:.3f} s): "
        f"{first.topic} number {first.seq} "
        + what.get(first.what, "was said now but is not recorded")
    ]
    for item in first.fields:
        delta = "" if item.delta == float("inf") else f"  |Δ| {item.delta:.3g}"
        lines.append(
            f"    {item.field:<28} recorded {item.recorded}  replayed {item.replayed}{delta}"
        )
    return lines


def show_lives(path: Path) -> int:
    """Print which lives are in a log; exit code 2 if there is none.

    Raises:
        LoggerError: the file cannot be read.
    """
    lives = runs_in(path)
    if not lives:
        print("the log has no journal of any service: nothing in it can be run again")
        return 2
    table = Table("service", "life", "steps", "seconds", "can be run again", box=None)
    for life in lives:
        first, last = life.span_ns
        verdict = f"no: {life.obstacle}" if life.obstacle else "yes"
        if life.ends and not life.obstacle:
            verdict = f"up to step {life.length - 1}: {life.ends}"
        steps = "" if life.obstacle else str(life.length)
        table.add_row(
            life.service, str(life.number), steps, f"{1e-9 * (last - first):.1f}", verdict
        )
    Console().print(table, highlight=False)
    return 0


@contextmanager
def _bar() -> Iterator[Progress]:
    """A progress bar on standard error, if that is a terminal."""
    console = Console(stderr=True)
    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as bar:
        yield bar
