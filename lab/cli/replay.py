"""``trill replay``: a log's services again, or a log back on the bus."""

import argparse
import sys
from pathlib import Path

from common.errors import ConfigError, TrillError
from deploy.system import LOG_FILE
from lab.cli.commands import Action

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
    if arguments.end <= arguments.start:
        raise ConfigError(
            f"expected --until after --from, got {arguments.end:g} and {arguments.start:g}"
        )
    # Only now: these bring much with them, which no other command should wait for.
    if not (arguments.check or arguments.service or arguments.list):
        _refuse_given(arguments, ("life", "tolerance", "settings", "out"), "needs --service")
        from lab.logs.playback import PlayOptions, play

        return play(log_path(arguments.log), PlayOptions.from_arguments(arguments))
    _refuse_given(arguments, ("loop", "topics", "robot", "connect"), "is for publishing only")
    from lab.logs.replay_check import SERVICES, UNREPLAYABLE, CheckOptions, parse_settings
    from lab.logs.replay_report import check, show_lives

    unknown = set(arguments.service) - SERVICES.keys() - UNREPLAYABLE.keys()
    if unknown:
        raise ConfigError(
            f"--service: expected one of {', '.join(SERVICES)}, got {', '.join(sorted(unknown))}"
        )
    try:
        if arguments.list:
            return show_lives(log_path(arguments.log))
        options = CheckOptions(
            tuple(dict.fromkeys(arguments.service)),
            arguments.life,
            arguments.tolerance,
            (arguments.start, arguments.end),
            parse_settings(arguments.settings),
            arguments.out,
            arguments.verbose,
        )
        return check(log_path(arguments.log), options)
    except TrillError as error:
        print(f"trill replay: {error}", file=sys.stderr)
        return 2


def log_path(given: Path) -> Path:
    """The log itself, given it or its run's directory."""
    return given / LOG_FILE if given.is_dir() else given


def _refuse_given(arguments: argparse.Namespace, names: tuple[str, ...], why: str) -> None:
    options = {"settings": "set", "robot": "as"}
    for name in names:
        if getattr(arguments, name):
            raise ConfigError(f"--{options.get(name, name)} {why}")


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


ACTION = Action(TEXT, EXAMPLES, add_arguments, run)
