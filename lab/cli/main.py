"""``trill``: one command for everything a person does with the system."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from common.errors import ConfigError, TrillError
from common.transport.config import bus_of
from deploy.launch import Ended
from deploy.system import LOG_FILE, RUNS
from lab.cli import collect, dataset, export, latency, ledger, logs, replay, study, system, tasks
from lab.cli.commands import Command

EPILOG = """Each command explains itself: trill demo --help. A run leaves its files in
runs/<date-time>/: log.mcap (every message), summary.json, contact_sheet.png, video.mp4 and the
services' own output in logs/."""

TOP = """Live table of a running system, from any terminal, as often as you like: the controller's
state and the plant's guard; each service's life and loop timing; injected delays, asked for and
done; services that are gone or go by another clock; each topic's rate, age and losses; and where
the time of each input's messages went (median/p99 of the last two seconds in ms; `trill ledger
--help` explains the stages). Fits the terminal. Publishes nothing. Written to a pipe or file it is
a line every few seconds."""
TOP_EXAMPLES = """examples:
  trill top                           the system on the standard ports
  trill top --base-port 7464          the one that printed this base port when it started
  trill top --ledger                  the latency of every input, nothing else
  TRILL_CONNECT=tcp/robot:7447 TRILL_MODE=client trill top
"""
REPORT = """Sum up a recorded run again from its log.mcap: writes summary.json and contact_sheet.png
(and, with --video, video.mp4) into its directory and prints the report. Works on logs cut off by a
crash."""
REPORT_EXAMPLES = """examples:
  trill report runs/20260131-120000
  trill report runs/20260131-120000 --video
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code (0, 1 for trouble, 2 for wrong options)."""
    arguments = _parser().parse_args(argv)
    try:
        command: Command = arguments.command
        return command.run(arguments)
    except ConfigError as error:
        print(f"trill: {error}", file=sys.stderr)
        return 2
    except TrillError as error:
        print(f"trill: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="trill",
        description="Teleoperate, record and watch a humanoid made of independent services.",
        epilog=EPILOG,
    )
    commands = parser.add_subparsers(required=True, metavar="command")
    for command in COMMANDS:
        command.add_to(commands, "command")
    return parser


def _top_arguments(parser: argparse.ArgumentParser) -> None:
    system.bus_options(parser, "of the system to watch (7448, or TRILL_BASE_PORT)")
    parser.add_argument("--robot", help="its name (draco3, or TRILL_ROBOT)")
    part = parser.add_mutually_exclusive_group()
    part.add_argument("--topics", action="store_true", help="show nothing but all topics")
    part.add_argument(
        "--ledger", action="store_true", help="show nothing but the latency of all inputs"
    )


def _top(arguments: argparse.Namespace) -> int:
    from lab.monitor.monitor import watch
    from lab.monitor.table import Content

    bus = bus_of(arguments.base_port, arguments.config, arguments.robot)
    content = (
        Content.TOPICS if arguments.topics else Content.LEDGER if arguments.ledger else Content.ALL
    )
    watch(bus, f"trill top  {bus.robot}  base port {bus.base_port}", content)
    return 0


def _report_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "run", type=Path, help=f"the run's directory, in {RUNS}/ as a rule, or its log"
    )
    parser.add_argument("--video", action="store_true", help="render video.mp4 too")


def _report(arguments: argparse.Namespace) -> int:
    from lab.review.report import finish, known_verdict

    run: Path = arguments.run
    run_dir = run.parent if run.name == LOG_FILE else run
    verdict, settings = known_verdict(run_dir)
    finish(Ended(run_dir, verdict), settings, pictures=True, video=arguments.video)
    return 0


COMMANDS = (
    *system.COMMANDS,
    Command("top", "live table of a running system", TOP, TOP_EXAMPLES, _top_arguments, _top),
    *logs.COMMANDS,
    ledger.COMMAND,
    latency.COMMAND,
    tasks.COMMAND,
    collect.COMMAND,
    dataset.COMMAND,
    study.COMMAND,
    Command("report", "sum up a recorded run", REPORT, REPORT_EXAMPLES, _report_arguments, _report),
    Command(
        "replay",
        "run a log's services again, or publish it",
        replay.TEXT,
        replay.EXAMPLES,
        replay.add_arguments,
        replay.run,
    ),
    Command(
        "export",
        "a log for viewers",
        export.EXPORT,
        export.EXPORT_EXAMPLES,
        export.takes_export,
        export.export,
    ),
    Command(
        "view", "a log in Rerun", export.VIEW, export.VIEW_EXAMPLES, export.takes_view, export.view
    ),
)
