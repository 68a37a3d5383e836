"""Replays service runs of a log and prints the comparison, for ``trill replay``."""

import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

from common.errors import ConfigError, TrillError
from common.runtime.replay.result import Report
from lab.logs.replay_check import Checker, CheckOptions, runs_in, select_runs
from lab.progress import ProgressBar


def check(path: Path, options: CheckOptions) -> int:
    """Replay the selected runs and report each; return the worst exit code.

    Raises:
        TrillError: nothing of it can be replayed, or the log cannot be read.
    """
    if options.settings and len(options.services) != 1:
        raise ConfigError("--set needs exactly one --service, whose settings it changes")
    runs = select_runs(runs_in(path), options.services, options.run)
    if not runs:
        raise ConfigError("nothing in the log can be replayed; --list says why")
    checker = Checker(path, options)
    codes = []
    for run in runs:
        name = f"{run.service}, run {run.number}"
        try:
            with ProgressBar(name) as bar:
                report = checker.check(run, bar.show)
        except TrillError as error:
            print(f"{name}: {error}", file=sys.stderr)
            codes.append(2)
            continue
        print("\n".join(report_lines(report, verbose=options.verbose)))
        codes.append(0 if report.identical else 1)
    if options.out is not None:
        print(f"{checker.write()} messages written to {options.out}")
    # A difference is worth more than a run that was not checked.
    return 1 if 1 in codes else max(codes)


def report_lines(report: Report, *, verbose: bool = False) -> list[str]:
    """Return a replay's report for a person, line by line."""
    speed = report.replayed / report.wall if report.wall else 0.0
    lines = [
        f"{report.service}, run {report.run}: {report.steps} steps, {report.replayed:.1f} s of "
        f"recording in {report.wall:.1f} s ({speed:.1f} x real time), {report.inputs} messages fed"
    ]
    for topic, output in sorted(report.outputs.items()):
        counts = {
            "within tolerance": output.close,
            "differing": output.differing,
            "missing": output.missing,
            "extra": output.extra,
            "not recorded": output.unrecorded,
        }
        others = "".join(f", {count} {what}" for what, count in counts.items() if count)
        lines.append(f"  {topic:<16} {output.compared:6d} compared, {output.equal} equal{others}")
    if report.failure and not report.stopped:
        lines.append(f"  it failed as in the recording: {report.failure}")
    lines += _difference_lines(report)
    if verbose and report.worst:
        lines.append("  largest relative difference by field:")
        ordered = sorted(report.worst.items(), key=lambda item: -item[1])
        lines += [f"    {name:<40} {value:.3g}" for name, value in ordered]
    if report.stopped:
        lines.append(f"  ended early: {report.stopped}")
    if report.identical:
        close = sum(output.close for output in report.outputs.values())
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
    what = {"differs": "differs", "missing": "was recorded but not published again"}
    lines = [
        f"  first difference at step {first.step} (clock {1e-9 * first.now_ns:.3f} s): "
        f"{first.topic} number {first.seq} "
        + what.get(first.what, "was published now but is not recorded")
    ]
    for item in first.fields:
        delta = "" if item.delta == float("inf") else f"  |Δ| {item.delta:.3g}"
        lines.append(
            f"    {item.field:<28} recorded {item.recorded}  replayed {item.replayed}{delta}"
        )
    return lines


def show_runs(path: Path) -> int:
    """Print the service runs in a log; return exit code 2 if there is none.

    Raises:
        LoggerError: the file cannot be read.
    """
    runs = runs_in(path)
    if not runs:
        print("the log has no journal of any service: nothing in it can be replayed")
        return 2
    table = Table("service", "run", "steps", "seconds", "can be replayed", box=None)
    for run in runs:
        first, last = run.span_ns
        verdict = f"no: {run.obstacle}" if run.obstacle else "yes"
        if run.ends and not run.obstacle:
            verdict = f"up to step {run.length - 1}: {run.ends}"
        steps = "" if run.obstacle else str(run.length)
        table.add_row(run.service, str(run.number), steps, f"{1e-9 * (last - first):.1f}", verdict)
    Console().print(table, highlight=False)
    return 0
