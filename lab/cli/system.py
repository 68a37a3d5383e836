"""``trill demo``, ``drive`` and ``up``: the commands that start a system."""

import argparse
import sys
from pathlib import Path

from common.errors import ConfigError
from deploy.launch import Ended
from deploy.process import Restart
from deploy.system import SystemOptions
from lab.cli import latency
from lab.cli.commands import Command

DEMO = """Start the whole system (plant, cameras, whole-body controller, scripted operator, logger),
each a process of its own that talks to the others over Zenoh only, and watch it in a live table
until the script ends: all six gaits, both hands standing and walking, both grippers. Then
everything is stopped and summed up from the log.

With --task a scored task is done instead, by the synthetic operator, in the task's scene: it acts
through the same device-level input as a person's headset and sees through the same feedback link.
It ends when the judge in the plant has its verdict.

Exit code 0: the script was played to its end, or the task was a success. Otherwise 1, and the
reason is printed: partial success or failure of the task, the robot fell, a service died, the
script failed, the time ran out."""
DEMO_EXAMPLES = """examples:
  trill demo                          about a minute and a half, then pictures
  trill demo --no-video               without the video, which takes about as long as the run
  trill demo --mode rated             with the torque limits of the real motors
  trill demo --script random          or stand, gaits, or a JSON file of your own
  trill demo --seconds 20             a short look
  trill demo --task door/unlock --seed 7                a scored task, see: trill tasks
  trill demo --task door/push --latency both=250ms      with a late robot
"""
DRIVE = """Start the robot (plant, cameras, whole-body controller, logger) and give you the keys:
hands, grippers, neck and gaits from this terminal. Leave with the key the screen shows; the run is
summed up like the demonstration."""
DRIVE_EXAMPLES = """examples:
  trill drive
  trill drive --no-cameras            leaves more of a small machine to the controller
  trill drive --video                 with a video of what you did
"""
UP = """Start the robot's side (plant, cameras, whole-body controller, logger) without an operator
and show the live table until Ctrl-C. A service that fails is started again, three times at most.
Operators come and go in terminals of their own; with --task, one that comes while none was there
begins a new trial (the plant is reset)."""
UP_EXAMPLES = """examples:
  trill up
  trill up --no-record                leaves nothing but the services' own output
  python -m services.teleop scripted --script gaits --gait turn_left      in another terminal
  python -m services.teleop keyboard
  trill up --task door/unlock --seed 7
  python -m services.teleop synthetic --task door/unlock --seed 7         in another terminal
"""


def bus_options(parser: argparse.ArgumentParser, port: str) -> None:
    """Add the options that say which system is meant."""
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
    parser.add_argument(
        "--seed",
        type=int,
        default=0,
        help="of noise, the task's start and the synthetic operator (0)",
    )
    bus_options(parser, "first port of the system (standard: a free block is found)")
    latency.add_latency_option(parser)


def _demo_arguments(parser: argparse.ArgumentParser) -> None:
    _system(parser)
    parser.add_argument(
        "--script",
        help="demo, stand, gaits, random, or a JSON file of steps (demo; with --task: none)",
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
    from lab.trials.links import system_links

    own = {} if arguments.task is None else _links_of(arguments.task)
    return SystemOptions(
        mode=arguments.mode,
        cameras=not arguments.no_cameras,
        record=not getattr(arguments, "no_record", False),
        config=arguments.config,
        restart=restart,
        task=arguments.task,
        seed=arguments.seed,
        links=system_links(arguments.latency, own, arguments.config),
    )


def _links_of(task: str) -> dict[str, str]:
    """The links that belong to a task."""
    try:
        # The tasks are found, and mujoco with them, only when one is asked for.
        from services.sim.errors import TaskError
        from services.sim.tasks import find_task

        try:
            return find_task(task).links
        except TaskError as error:
            raise ConfigError(f"--task: {error}") from error
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"--task: the scenes cannot be built without {error.name}: pip install 'trill[sim]'"
        ) from error


def _demo(arguments: argparse.Namespace) -> int:
    from lab.live.demo import DemoOptions, run_demo

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
    from lab.live.drive import run_drive

    ended = run_drive(_system_options(arguments, Restart.ON_FAILURE), arguments.base_port)
    return _finish(ended, arguments, pictures=True, video=arguments.video)


def _up_arguments(parser: argparse.ArgumentParser) -> None:
    _system(parser)
    parser.add_argument("--no-record", action="store_true", help="do not log")


def _up(arguments: argparse.Namespace) -> int:
    from lab.live.drive import run_up

    ended = run_up(_system_options(arguments, Restart.ON_FAILURE), arguments.base_port)
    if arguments.no_record:
        print(f"{ended.verdict.outcome}: {ended.verdict.reason}; output in {ended.run_dir}")
        return int(ended.verdict.outcome != "completed")
    return _finish(ended, arguments, pictures=False, video=False)


def _finish(ended: Ended, arguments: argparse.Namespace, *, pictures: bool, video: bool) -> int:
    """Sum up a run; exit code 0 only if it was completed."""
    from lab.review.report import finish

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
    Command(
        "demo",
        "the whole system by a script, or at a task",
        DEMO,
        DEMO_EXAMPLES,
        _demo_arguments,
        _demo,
    ),
    Command(
        "drive", "the whole system on your keys", DRIVE, DRIVE_EXAMPLES, _drive_arguments, _drive
    ),
    Command("up", "the robot's side, without an operator", UP, UP_EXAMPLES, _up_arguments, _up),
)
