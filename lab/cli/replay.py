"""``trill replay``: run a log's services again, or publish a log on the bus."""

import argparse
import sys
from pathlib import Path

from common.errors import ConfigError, TrillError
from lab.cli.bus import add_config_option, add_connect_option, chosen_bus
from lab.cli.commands import Action
from lab.cli.log_argument import add_log_argument, chosen_log
from services.logger.record.units import parse_patterns

TEXT = """Replay a log, in one of two ways.

With --service or --check: run the recorded services again, each step on exactly the messages that
it read then, and compare their outputs with the recorded ones, byte by byte. This shows on real
data whether a change of the code changes what the robot does, and where first.

Without: publish the recorded bytes on the bus at the recorded rate, for viewers. They are
published under another robot's name (draco3-replay), because a recorded command must never reach a
live robot. Where nobody recorded for longer than 10 s, between two segments, 1 s is waited; the
pauses are printed.

Exit codes: 0 identical, or published to the end; 1 different, or not replayed to the end; 2 cannot
be replayed: wrong options, or the log lacks something; 130 after Ctrl-C while checking."""
EXAMPLES = """examples:
  trill replay runs/20260131-120000 --list                    what can be replayed
  trill replay runs/20260131-120000 --check                   all of it
  trill replay log.mcap --service wbc --run 2                 after its restart
  trill replay log.mcap --service wbc --tolerance 1e-9        recorded on another kind of machine
  trill replay log.mcap --service wbc --set tasks.torso.kp=90 --out softer.mcap
  trill replay log.mcap                                       publish it
  trill top --robot draco3-replay                             watch that, in another terminal
  trill replay log.mcap --speed 2 --loop --topics 'plant/*' --from 10 --until 20
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trill replay``."""
    add_log_argument(parser)
    parser.add_argument(
        "--from",
        dest="start",
        type=_seconds,
        default=0.0,
        metavar="S",
        help="begin here [s] in the recording; when checking, in the run, whose earlier steps are "
        "replayed but not compared",
    )
    parser.add_argument(
        "--until", dest="end", type=_seconds, default=float("inf"), metavar="S", help="end here [s]"
    )
    _add_check_arguments(parser.add_argument_group("run services again"))
    _add_publish_arguments(parser.add_argument_group("publish"))


def _add_check_arguments(check: argparse._ArgumentGroup) -> None:
    check.add_argument(
        "--list", action="store_true", help="only list the runs of services in the log"
    )
    check.add_argument(
        "--check", action="store_true", help="compare outputs; of all services if none is named"
    )
    check.add_argument(
        "--service",
        action="append",
        default=[],
        help="replay this service; may be given several times",
    )
    check.add_argument("--run", type=int, metavar="N", help="only the Nth run of a service (all)")
    check.add_argument(
        "--tolerance",
        type=_seconds,
        default=0.0,
        metavar="X",
        help="accept numbers that differ by this, relative to the field's largest (0: exactly "
        "equal); other processors round differently",
    )
    check.add_argument(
        "--set",
        dest="settings",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change a setting of the service before",
    )
    check.add_argument("--out", type=Path, metavar="FILE", help="write the outputs to this log")
    check.add_argument(
        "--verbose",
        action="store_true",
        help="show every field that differs, and what the services log",
    )


def _add_publish_arguments(play: argparse._ArgumentGroup) -> None:
    play.add_argument(
        "--speed", type=_positive, default=1.0, help="times that of the recording (1)"
    )
    play.add_argument("--loop", action="store_true", help="repeat until Ctrl-C")
    play.add_argument(
        "--topics",
        type=parse_patterns,
        default=(),
        metavar="PATTERNS",
        help="only these, separated by commas or blanks, e.g. 'camera/*,plant/state' (all)",
    )
    play.add_argument(
        "--as",
        dest="robot",
        metavar="ROBOT",
        help="publish as this robot (<recorded name>-replay); refused if a robot of that name is "
        "on the bus",
    )
    play.add_argument("--base-port", type=int, help="port of the bus (7448, or TRILL_BASE_PORT)")
    add_connect_option(play)
    add_config_option(play)


def run(arguments: argparse.Namespace) -> int:
    """Replay or publish a log; return the exit code."""
    if arguments.end <= arguments.start:
        raise ConfigError(
            f"expected --until after --from, got {arguments.end:g} and {arguments.start:g}"
        )
    # These imports take long; other commands should not wait for them.
    if not (arguments.check or arguments.service or arguments.list):
        _refuse_given(arguments, ("run", "tolerance", "settings", "out"), "needs --service")
        from lab.logs.playback import PlayOptions, play

        published = PlayOptions(
            chosen_bus(arguments),
            arguments.robot is not None,
            arguments.speed,
            arguments.loop,
            (arguments.start, arguments.end),
            arguments.topics,
        )
        return play(chosen_log(arguments.log), published)
    _refuse_given(arguments, ("loop", "topics", "robot", "connect"), "is for publishing only")
    from lab.logs.replay_check import SERVICES, UNREPLAYABLE, CheckOptions, parse_settings
    from lab.logs.replay_report import check, show_runs

    unknown = set(arguments.service) - SERVICES.keys() - UNREPLAYABLE.keys()
    if unknown:
        raise ConfigError(
            f"--service: expected one of {', '.join(SERVICES)}, got {', '.join(sorted(unknown))}"
        )
    try:
        log = chosen_log(arguments.log)
        if arguments.list:
            return show_runs(log)
        options = CheckOptions(
            tuple(dict.fromkeys(arguments.service)),
            arguments.run,
            arguments.tolerance,
            (arguments.start, arguments.end),
            parse_settings(arguments.settings),
            arguments.out,
            arguments.verbose,
        )
        return check(log, options)
    except TrillError as error:
        print(f"trill replay: {error}", file=sys.stderr)
        return 2


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


ACTION = Action(TEXT, EXAMPLES, add_arguments, run)
