"""``trill replay``: a log's services again, or a log back on the bus."""

import argparse
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.table import Table

from common.errors import ConfigError, TrillError
from common.runtime.lives import Life
from common.runtime.replay_report import Report
from deploy.replay_check import (
    SERVICES,
    Checker,
    CheckOptions,
    chosen,
    lives_in,
    log_path,
    parse_settings,
)

TEXT = """Replay a log, in one of two ways.

With --service or --check: run the recorded services again, each step on exactly the messages it
took in then, and compare what they say with what they said, to the byte. It shows whether a change
changes what the robot does, on real data, and where first.

Without: publish the log on the bus at the pace of the recording, with the recorded bytes, for
viewers. It plays under another robot's name (draco3-replay), since a recorded command must never
reach a live robot.

Exit codes: 0 identical, or played to the end; 1 differing, or not followed to the end; 2 cannot be
replayed: wrong options, or the log lacks what it takes. 130 after Ctrl-C while checking."""
EXAMPLES = """examples:
  trill replay runs/20260131-120000 --list                    what can be run again
  trill replay runs/20260131-120000 --check                   all of it
  trill replay log.mcap --service wbc --life 2                after its restart
  trill replay log.mcap --service wbc --tolerance 1e-9        recorded on another kind of machine
  trill replay log.mcap --service wbc --set tasks.torso.kp=90 --out softer.mcap
  trill replay log.mcap                                       publish it
  trill top --robot draco3-replay                             watch that, in another terminal
  trill replay log.mcap --speed 2 --loop --topics 'plant/*' --from 10 --until 20
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trill replay``."""
    parser.add_argument("log", type=Path, help="log.mcap, or the directory of its run")
    parser.add_argument(
        "--from",
        dest="start",
        type=_seconds,
        default=0.0,
        metavar="S",
        help="begin here [s]: of the recording; when checking, of the life, and "
        "what comes before is replayed but not compared",
    )
    parser.add_argument(
        "--until", dest="end", type=_seconds, default=float("inf"), metavar="S", help="end here [s]"
    )
    check = parser.add_argument_group("run services again")
    check.add_argument("--list", action="store_true", help="show the lives in the log, no more")
    check.add_argument("--check", action="store_true", help="compare; all services if none named")
    check.add_argument(
        "--service",
        action="append",
        default=[],
        choices=sorted(SERVICES),
        help="this one; may be given several times",
    )
    check.add_argument("--life", type=int, metavar="N", help="the Nth life only (all)")
    check.add_argument(
        "--tolerance",
        type=_seconds,
        default=0.0,
        metavar="X",
        help="accept numbers that differ by this, relative to the field's largest "
        "(0: not by a bit); other processors round otherwise",
    )
    check.add_argument(
        "--set",
        dest="settings",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change the service's settings: what would it have done?",
    )
    check.add_argument("--out", type=Path, metavar="FILE", help="write what they say to this log")
    check.add_argument(
        "--verbose",
        action="store_true",
        help="show every field that differs, and what the services log",
    )
    play = parser.add_argument_group("publish")
    play.add_argument("--speed", type=_positive, default=1.0, help="of the recording's (1)")
    play.add_argument("--loop", action="store_true", help="over and over, until Ctrl-C")
    play.add_argument(
        "--topics",
        type=_names,
        default=(),
        metavar="NAMES",
        help="only these, by commas; camera/* for several (all)",
    )
    play.add_argument(
        "--as",
        dest="robot",
        metavar="ROBOT",
        help="under this robot's name (the recorded one and -replay); refused if "
        "somebody of that name is on the bus",
    )
    play.add_argument("--base-port", type=int, help="of the bus (7448, or TRILL_BASE_PORT)")
    play.add_argument(
        "--connect",
        type=_names,
        metavar="ENDPOINTS",
        help="join there as a client instead, e.g. tcp/192.0.2.7:7447",
    )
    play.add_argument("--config", type=Path, help="TOML file for the whole stack")


def run(arguments: argparse.Namespace) -> int:
    """Do what the options say; returns the exit code."""
    path = log_path(arguments.log)
    if arguments.end <= arguments.start:
        raise ConfigError(
            f"expected --until after --from, got {arguments.end:g} and {arguments.start:g}"
        )
    checking = arguments.check or bool(arguments.service)
    if not (checking or arguments.list):
        _refuse_given(arguments, ("life", "tolerance", "settings", "out"), "needs --service")
        from deploy.playback import PlayOptions, play

        return play(path, PlayOptions.from_arguments(arguments))
    _refuse_given(arguments, ("loop", "topics", "robot", "connect"), "is for publishing only")
    try:
        lives = lives_in(path)
        if arguments.list:
            _show_lives(lives)
            return 0 if lives else 2
        return _check(path, lives, arguments)
    except TrillError as error:
        print(f"trill replay: {error}", file=sys.stderr)
        return 2


def _check(path: Path, lives: list[Life], arguments: argparse.Namespace) -> int:
    """Replay what is asked for, report each, return the worst exit code."""
    settings = parse_settings(arguments.settings)
    if settings and len(set(arguments.service)) != 1:
        raise ConfigError("--set needs exactly one --service, whose settings it changes")
    picked = chosen(lives, list(dict.fromkeys(arguments.service)), arguments.life)
    if not picked:
        raise ConfigError("nothing in the log can be replayed; --list says why")
    options = CheckOptions(
        arguments.life,
        arguments.tolerance,
        (arguments.start, arguments.end),
        settings,
        arguments.out,
        arguments.verbose,
    )
    checker = Checker(path, options)
    codes = []
    for life in picked:
        try:
            report = _replayed(checker, life)
        except TrillError as error:
            print(f"{life.service}, life {life.number}: {error}", file=sys.stderr)
            codes.append(2)
            continue
        print("\n".join(report_lines(report, verbose=arguments.verbose)))
        codes.append(0 if report.identical else 1)
    if arguments.out is not None:
        print(f"{checker.write()} messages written to {arguments.out}")
    # Differing says more than not checked.
    return 1 if 1 in codes else max(codes)


def _replayed(checker: Checker, life: Life) -> Report:
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


def _show_lives(lives: list[Life]) -> None:
    """The table of ``--list``."""
    if not lives:
        print("the log has no journal of any service: nothing in it can be run again")
        return
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


def _refuse_given(arguments: argparse.Namespace, names: tuple[str, ...], why: str) -> None:
    options = {"settings": "set", "robot": "as"}
    for name in names:
        if getattr(arguments, name):
            raise ConfigError(f"--{options.get(name, name)} {why}")


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


def _seconds(text: str) -> float:
    value = float(text)
    if not value >= 0.0:
        raise argparse.ArgumentTypeError(f"expected 0 or more, got {text}")
    return value


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value <= 1000.0:
        raise argparse.ArgumentTypeError(f"expected more than 0 and at most 1000, got {text}")
    return value


def _names(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(",") if part.strip())
