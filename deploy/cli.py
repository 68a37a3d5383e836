"""``trill``: one command for everything a person does with the system."""

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from common.errors import ConfigError, TrillError
from deploy import collect_cli, latency_cli, ledger_cli, logs_cli, replay_cli, tasks_cli
from deploy import export_cli as ex
from deploy.launch import Ended
from deploy.process import Restart
from deploy.system import LOG_FILE, RUNS, SystemOptions, bus_of

EPILOG = """Each command explains itself: trill demo --help. A run leaves its files in
runs/<date-time>/: log.mcap (every message), summary.json, contact_sheet.png, video.mp4 and the
services' own output in logs/."""

DEMO = """Start the whole system (plant, cameras, whole-body controller, scripted operator, logger),
each a process of its own that talks to the others over Zenoh only, and watch it in a live table
until the script ends: all six gaits, both hands standing and walking, both grippers. Then
everything is stopped and summed up from the log.

Exit code 0: the script was played to its end. Otherwise the reason is printed: the robot fell, a
service died, the script failed, the time ran out."""
DEMO_EXAMPLES = """examples:
  trill demo                          about a minute and a half, then pictures
  trill demo --no-video               without the video, which takes about as long as the run
  trill demo --mode rated             with the torque limits of the real motors
  trill demo --script random          or stand, gaits, or a JSON file of your own
  trill demo --seconds 20             a short look
"""
DRIVE = """Start the robot (plant, cameras, whole-body controller, logger) and give you the keys:
hands, grippers, neck and gaits from this terminal. Leave with the key the screen shows; the run is
summed up like the demonstration."""
DRIVE_EXAMPLES = """examples:
  trill drive
  trill drive --no-cameras            leaves more of a small machine to the controller
  trill drive --video                 with a video of what you did
"""
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
UP = """Start the robot's side (plant, cameras, whole-body controller, logger) without an operator
and show the live table until Ctrl-C. A service that fails is started again, three times at most.
Operators come and go in terminals of their own."""
UP_EXAMPLES = """examples:
  trill up
  trill up --no-record                leaves nothing but the services' own output
  python -m services.teleop scripted --script gaits --gait turn_left      in another terminal
  python -m services.teleop keyboard
"""
REPORT = """Sum up a recorded run again from its log.mcap: writes summary.json and contact_sheet.png
(and, with --video, video.mp4) into its directory and prints the report. Works on logs cut off by a
crash."""
REPORT_EXAMPLES = """examples:
  trill report runs/20260131-120000
  trill report runs/20260131-120000 --video
"""


@dataclass(frozen=True)
class _Command:
    """One subcommand: what it is, what it takes, what it does."""

    name: str
    brief: str
    text: str
    examples: str
    add: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code (0, 1 for trouble, 2 for wrong options)."""
    arguments = _parser().parse_args(argv)
    try:
        command: _Command = arguments.command
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
        sub = commands.add_parser(
            command.name,
            help=command.brief,
            description=command.text,
            epilog=command.examples,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        command.add(sub)
        sub.set_defaults(command=command)
    return parser


def _bus(parser: argparse.ArgumentParser, port: str) -> None:
    parser.add_argument("--config", type=Path, help="TOML file for the whole stack")
    parser.add_argument("--base-port", type=int, help=port)


def _system(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--mode",
        choices=["relaxed", "rated"],
        default="relaxed",
        help="torque limits of plant and controller: relaxed (legs +200 N·m, as the public TRILL "
        "simulation; the standard) or rated (the URDF's; stands taller, walks slower)",
    )
    parser.add_argument("--no-cameras", action="store_true", help="the robot does not see")
    parser.add_argument("--task", help="a scored task in its scene, e.g. door/unlock (trill tasks)")
    parser.add_argument("--seed", type=int, default=0, help="of noise and the task's start (0)")
    _bus(parser, "first port of the system (standard: a free block is found)")
    latency_cli.add_latency_option(parser)


def _demo_arguments(parser: argparse.ArgumentParser) -> None:
    _system(parser)
    parser.add_argument(
        "--script", default="demo", help="demo, stand, gaits, random, or a JSON file of steps"
    )
    parser.add_argument("--seconds", type=float, help="end after this long, wherever the script is")
    parser.add_argument(
        "--timeout", type=float, default=600.0, help="failed if not done by then [s] (600)"
    )
    parser.add_argument("--no-video", action="store_true", help="do not render video.mp4")
    parser.add_argument("--no-pictures", action="store_true", help="render nothing at all")
    parser.add_argument(
        "--headless", action="store_true", help="plain lines instead of the live table"
    )


def _system_options(arguments: argparse.Namespace, restart: Restart) -> SystemOptions:
    if arguments.task is not None:
        from services.sim.tasks import find_task

        find_task(arguments.task)
    return SystemOptions(
        mode=arguments.mode,
        cameras=not arguments.no_cameras,
        record=not getattr(arguments, "no_record", False),
        config=arguments.config,
        restart=restart,
        task=arguments.task,
        seed=arguments.seed,
        links=latency_cli.chosen_links(arguments.latency),
    )


def _demo(arguments: argparse.Namespace) -> int:
    from deploy.demo import DemoOptions, run_demo

    ended = run_demo(
        DemoOptions(
            system=_system_options(arguments, Restart.NEVER),
            script=arguments.script,
            seconds=arguments.seconds,
            timeout=arguments.timeout,
            base_port=arguments.base_port,
            live=False if arguments.headless else None,
        )
    )
    pictures, video = not arguments.no_pictures, not arguments.no_video
    return _finish(ended, arguments, pictures=pictures, video=pictures and video)


def _drive_arguments(parser: argparse.ArgumentParser) -> None:
    _system(parser)
    parser.add_argument("--video", action="store_true", help="render video.mp4 afterwards")


def _drive(arguments: argparse.Namespace) -> int:
    from deploy.drive import run_drive

    ended = run_drive(_system_options(arguments, Restart.ON_FAILURE), arguments.base_port)
    return _finish(ended, arguments, pictures=True, video=arguments.video)


def _up_arguments(parser: argparse.ArgumentParser) -> None:
    _system(parser)
    parser.add_argument("--no-record", action="store_true", help="do not log")


def _up(arguments: argparse.Namespace) -> int:
    from deploy.drive import run_up

    ended = run_up(_system_options(arguments, Restart.ON_FAILURE), arguments.base_port)
    if arguments.no_record:
        print(f"{ended.verdict.outcome}: {ended.verdict.reason}; output in {ended.run_dir}")
        return int(ended.verdict.outcome != "completed")
    return _finish(ended, arguments, pictures=False, video=False)


def _top_arguments(parser: argparse.ArgumentParser) -> None:
    _bus(parser, "of the system to watch (7448, or TRILL_BASE_PORT)")
    parser.add_argument("--robot", help="its name (draco3, or TRILL_ROBOT)")
    part = parser.add_mutually_exclusive_group()
    part.add_argument("--topics", action="store_true", help="show nothing but all topics")
    part.add_argument(
        "--ledger", action="store_true", help="show nothing but the latency of all inputs"
    )


def _top(arguments: argparse.Namespace) -> int:
    from deploy.monitor import watch
    from deploy.table import Show

    bus = bus_of(arguments.base_port, arguments.config, arguments.robot)
    show = Show.TOPICS if arguments.topics else Show.LEDGER if arguments.ledger else Show.ALL
    watch(bus, f"trill top  {bus.robot}  base port {bus.base_port}", show)
    return 0


def _report_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "run", type=Path, help=f"the run's directory, in {RUNS}/ as a rule, or its log"
    )
    parser.add_argument("--video", action="store_true", help="render video.mp4 too")


def _report(arguments: argparse.Namespace) -> int:
    from deploy.report import finish, known_verdict

    run: Path = arguments.run
    run_dir = run.parent if run.name == LOG_FILE else run
    verdict, settings = known_verdict(run_dir)
    finish(Ended(run_dir, verdict), settings, pictures=True, video=arguments.video)
    return 0


def _finish(ended: Ended, arguments: argparse.Namespace, *, pictures: bool, video: bool) -> int:
    """Sum up a run; exit code 0 only if it was completed."""
    from deploy.report import finish

    if ended.verdict.outcome != "completed":
        # Said at once: if there is no log to read, this is why.
        print(f"trill: {ended.verdict.outcome}: {ended.verdict.reason}", file=sys.stderr)
    settings = {"mode": arguments.mode, "config": str(arguments.config or "")}
    summary = finish(ended, settings, pictures=pictures, video=video)
    if summary.outcome == "completed":
        return 0
    print(f"trill: failed: {summary.outcome}", file=sys.stderr)
    return 1


COMMANDS = (
    _Command("demo", "the whole system by a script", DEMO, DEMO_EXAMPLES, _demo_arguments, _demo),
    _Command(
        "drive", "the whole system on your keys", DRIVE, DRIVE_EXAMPLES, _drive_arguments, _drive
    ),
    _Command("up", "the robot's side, without an operator", UP, UP_EXAMPLES, _up_arguments, _up),
    _Command("top", "live table of a running system", TOP, TOP_EXAMPLES, _top_arguments, _top),
    *(_Command(*entry) for entry in logs_cli.ENTRIES),
    _Command(*ledger_cli.ENTRY),
    _Command(*latency_cli.ENTRY),
    _Command(*tasks_cli.ENTRY),
    _Command(*collect_cli.ENTRY),
    _Command(
        "report", "sum up a recorded run", REPORT, REPORT_EXAMPLES, _report_arguments, _report
    ),
    _Command(
        "replay",
        "run a log's services again, or publish it",
        replay_cli.TEXT,
        replay_cli.EXAMPLES,
        replay_cli.add_arguments,
        replay_cli.run,
    ),
    _Command(
        "export", "a log for viewers", ex.EXPORT, ex.EXPORT_EXAMPLES, ex.takes_export, ex.export
    ),
    _Command("view", "a log in Rerun", ex.VIEW, ex.VIEW_EXAMPLES, ex.takes_view, ex.view),
)

if __name__ == "__main__":
    raise SystemExit(main())
