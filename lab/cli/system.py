"""Commands that start a system: ``trill demo``, ``trill drive`` and ``trill up``."""

import argparse
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from common.errors import ConfigError
from common.packages import require
from common.tables import validated
from deploy.system import LOG_FILE, SystemOptions
from lab.cli.bus import add_config_option
from lab.cli.commands import Action
from lab.cli.policy_task import say_other_task
from services.policy.options import add_inference_options, inference_arguments
from services.policy.runtimes.load import require_runtime

if TYPE_CHECKING:
    from deploy.launch import RunResult
    from deploy.process import ProcessSpec
    from services.policy.checkpoint.manifest import Manifest

DEMO = """Start the whole system and watch it in a live table until the operator's script ends.
Plant, cameras, whole-body controller, scripted operator and logger are separate processes that talk
to each other over Zenoh only. The script shows all six gaits, both hands standing and walking, and
both grippers. Then everything is stopped, and the log is summed up in a report and pictures.

With --task, the synthetic operator does a scored task in the task's scene. It acts through the same
device-level input as a person's headset and sees the robot through the same feedback link. The run
ends when the judge in the plant has given its verdict.

With --policy, a policy that has learned the task does it, from what the cameras show.

The exit code is 0 if the script was played to its end or the task was a success. Otherwise it is 1
and the reason is printed: partial success or failure of the task, a fall of the robot, the end of a
service, a failed script or a timeout."""
DEMO_EXAMPLES = """examples:
  trill demo                          takes about a minute and a half, then draws the pictures
  trill demo --no-video               saves the video, which takes about as long as the run
  trill demo --torque-mode rated      uses the torque limits of the real motors
  trill demo --script random          plays another script: stand, gaits or your own JSON file
  trill demo --seconds 20             ends after 20 seconds
  trill demo --task door/unlock --seed 7                does a scored task; see: trill tasks
  trill demo --task door/push --latency both=250ms      does it with a delayed robot
  trill demo --policy policies/door-unlock              a learned policy does its task
"""
DRIVE = """Start the robot (plant, cameras, whole-body controller, logger) and control its hands,
grippers, neck and gaits with the keys of this terminal. The screen shows the keys, also the one to
leave with. Afterwards the log is summed up in a report and pictures, as by trill demo."""
DRIVE_EXAMPLES = """examples:
  trill drive
  trill drive --no-cameras            leaves more of a small machine to the controller
  trill drive --video                 renders a video afterwards
"""
UP = """Start the robot's side (plant, cameras, whole-body controller, logger) without an operator
and show the live table until Ctrl-C. A service that fails is restarted, up to three times.
Operators come and go in terminals of their own, and start after it: one that waits already keeps a
port that it needs. With --task, an operator that comes while no other
one is there begins a new trial: the plant is reset.

With --teleop, a person operates the robot from a browser or a WebXR headset; the link is printed.
`web` serves this machine only, `lan` the whole network; see trill teleop --help.

With --policy, a policy operates the robot whenever nobody else has it. A person takes the robot
with an operator of their own and gives it back; the policy then goes on."""
UP_EXAMPLES = """examples:
  trill up
  trill up --no-record                writes no log
  python -m services.teleop scripted --script gaits --gait turn_left      in another terminal
  python -m services.teleop keyboard                                      or control it yourself
  trill up --task door/unlock --seed 7
  python -m services.teleop synthetic --task door/unlock --seed 7         in another terminal
  trill up --task door/unlock --teleop web                open the link in a browser
  trill up --task door/unlock --policy runs/unlock/best
  python -m services.teleop keyboard           takes the robot from it by Enter, and gives it back
  trill up --policy runs/unlock/best --runtime onnx        without torch; see trill export-policy
  trill up --policy runs/unlock/best --remote  a server computes: python -m services.policy.server
"""


def _add_system_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--torque-mode",
        choices=["relaxed", "rated"],
        help="torque limits of plant and controller: relaxed adds 200 N·m to the legs, as the "
        "public TRILL simulation does; rated keeps those of the URDF, with which the robot stands "
        "taller and walks more slowly (default: the configuration's, else relaxed)",
    )
    parser.add_argument("--no-cameras", action="store_true", help="start no cameras")
    parser.add_argument(
        "--task", help="name of a scored task, e.g. door/unlock; trill tasks lists them"
    )
    parser.add_argument(
        "--seed",
        type=int,
        help="seed of sensor noise, the task's start and the synthetic operator (default: the "
        "configuration's, else 0)",
    )
    add_config_option(parser)
    parser.add_argument(
        "--base-port",
        type=int,
        help="first port of the system (default: a free block of ports is found)",
    )
    parser.add_argument(
        "--latency",
        action="append",
        default=[],
        metavar="NAME=SPEC",
        help="inject a delay, e.g. command=250ms or 'camera=normal(122ms, 190ms) loss=1%%', or "
        "those of a TOML file's table [links]; may be given several times; see trill latency "
        "--help. A task's own link holds unless links are given; 'none' switches it off",
    )


def _add_policy_options(parser: argparse.ArgumentParser, what: str) -> None:
    group = parser.add_argument_group("policy")
    group.add_argument(
        "--policy", type=Path, metavar="CHECKPOINT", help=f"folder of a policy, {what}"
    )
    add_inference_options(group)


def _inference(arguments: argparse.Namespace) -> tuple[str, ...]:
    """Return the options that say where and by what a policy is computed.

    Raises:
        ConfigError: there are some, and no policy, or the runtime is not installed.
    """
    found = inference_arguments(arguments)
    if found and arguments.policy is None:
        raise ConfigError(f"{found[0]} says how a policy is computed; give --policy too")
    if "runtime" in arguments and "remote" not in arguments:
        require_runtime(arguments.runtime)
    return found


def _demo_arguments(parser: argparse.ArgumentParser) -> None:
    _add_system_options(parser)
    parser.add_argument(
        "--script",
        help="script of the operator: demo, stand, gaits, random or a JSON file of steps "
        "(default: demo; none with --task)",
    )
    _add_policy_options(parser, "which does the task (default: the one it has learned)")
    parser.add_argument(
        "--seconds", type=float, help="end this long after the controller was first heard [s]"
    )
    parser.add_argument(
        "--timeout", type=float, default=600.0, help="give up after this time [s] (default: 600)"
    )
    parser.add_argument("--no-video", action="store_true", help="do not render video.mp4")
    parser.add_argument("--no-pictures", action="store_true", help="render nothing at all")
    parser.add_argument(
        "--headless", action="store_true", help="print lines instead of the live table"
    )


def _system_options(arguments: argparse.Namespace, *, restart: bool) -> SystemOptions:
    from lab.trials.links import system_links

    task_links = {} if arguments.task is None else _links_of(arguments.task)
    return SystemOptions(
        torque_mode=arguments.torque_mode,
        cameras=not arguments.no_cameras,
        record=not getattr(arguments, "no_record", False),
        config=arguments.config,
        restart=restart,
        task=arguments.task,
        seed=arguments.seed,
        links=system_links(arguments.latency, task_links, arguments.config),
    )


def _links_of(task: str) -> dict[str, str]:
    """Return the links that belong to a task, by name."""
    # Tasks need MuJoCo, which is imported only when a task was named.
    require("--task", "sim", "mujoco")
    from services.sim.errors import TaskError
    from services.sim.tasks import find_task

    try:
        return find_task(task).links
    except TaskError as error:
        raise ConfigError(f"--task: {error}") from error


def _demo(arguments: argparse.Namespace) -> int:
    from lab.live.demo import DemoOptions, run_demo

    if arguments.policy is not None:
        _prepare_policy(arguments)
    ended = run_demo(
        DemoOptions(
            system=_system_options(arguments, restart=False),
            script=arguments.script,
            policy=arguments.policy,
            inference=_inference(arguments),
            seconds=arguments.seconds,
            timeout=arguments.timeout,
            base_port=arguments.base_port,
            live=False if arguments.headless else None,
        )
    )
    pictures, video = not arguments.no_pictures, not arguments.no_video
    return _finish(ended, arguments, pictures=pictures, video=pictures and video)


def _drive_arguments(parser: argparse.ArgumentParser) -> None:
    _add_system_options(parser)
    parser.add_argument("--video", action="store_true", help="render video.mp4 afterwards")


def _drive(arguments: argparse.Namespace) -> int:
    from lab.live.drive import run_drive

    ended = run_drive(_system_options(arguments, restart=True), arguments.base_port)
    return _finish(ended, arguments, pictures=True, video=arguments.video)


def _up_arguments(parser: argparse.ArgumentParser) -> None:
    _add_system_options(parser)
    parser.add_argument("--no-record", action="store_true", help="write no log")
    parser.add_argument(
        "--teleop",
        choices=["web", "lan"],
        help="serve the operator's page: web to this machine, lan to the whole network",
    )
    _add_policy_options(parser, "which operates the robot whenever nobody else does")


def _prepare_policy(arguments: argparse.Namespace) -> None:
    """Check a policy's options before anything is started, and give it the task that it knows.

    Raises:
        ConfigError: options contradict each other, or no task is known.
        CheckpointError: the checkpoint cannot be served.
    """
    if arguments.script is not None:
        raise ConfigError("expected one operator; give --policy or --script, not both")
    manifest = _checkpoint(arguments)
    arguments.policy = arguments.policy.resolve()
    arguments.task = arguments.task or manifest.origin.task
    say_other_task(arguments.policy, manifest.origin.task, arguments.task)
    if not arguments.task:
        raise ConfigError(f"{arguments.policy} does not say what it has learned; give --task")


def _checkpoint(arguments: argparse.Namespace) -> "Manifest":
    """Return the manifest of the policy that is to be started.

    Raises:
        ConfigError: it sees, and there are to be no cameras.
        CheckpointError: the checkpoint cannot be served, or not by the runtime that was chosen.
    """
    from services.policy.checkpoint.exported import read_exported
    from services.policy.checkpoint.manifest import describe

    description = describe(arguments.policy)
    if "remote" not in arguments and getattr(arguments, "runtime", "torch") != "torch":
        read_exported(arguments.policy, description)
    manifest = description.manifest
    cameras = manifest.interface.cameras
    if cameras and arguments.no_cameras:
        raise ConfigError(
            f"{arguments.policy} sees through the {' and '.join(cameras)} camera; expected the "
            "cameras to run: leave out --no-cameras"
        )
    return manifest


def _policies(arguments: argparse.Namespace) -> "list[ProcessSpec]":
    """Return the policy to start, if one is wanted.

    Raises:
        ConfigError: options contradict each other.
        CheckpointError: the checkpoint cannot be served.
    """
    from deploy.system import policy_process

    options = _inference(arguments)
    if arguments.policy is None:
        return []
    # Before anything is started.
    manifest = _checkpoint(arguments)
    say_other_task(arguments.policy, manifest.origin.task, arguments.task)
    return [policy_process(arguments.policy.resolve(), *options)]


def _pages(arguments: argparse.Namespace) -> "list[ProcessSpec]":
    """Return the operator in a browser, if one is wanted, and print the link to its page.

    Raises:
        ConfigError: a package is missing, or the table ``[headset]`` is wrong.
        TeleopError: certificate or token cannot be kept.
    """
    from common.transport.config import read_config_file
    from deploy.system import headset_process
    from services.teleop.headset.config import EVERY_ADDRESS, PACKAGES, HeadsetConfig

    if arguments.teleop is None:
        return []
    require("--teleop", "headset", *PACKAGES)
    from services.teleop.headset.credentials import prepare
    from services.teleop.headset.serve import invitation

    path = arguments.config or os.environ.get("TRILL_CONFIG")
    table = read_config_file(Path(path), also=["headset"]).get("headset", {}) if path else {}
    lan = {"address": EVERY_ADDRESS} if arguments.teleop == "lan" else {}
    config = validated(HeadsetConfig, table, lan)
    print(invitation(prepare(config), config.port))
    return [headset_process(*(["--lan"] if lan else []))]


def _up(arguments: argparse.Namespace) -> int:
    from lab.live.drive import run_up

    operators = [*_policies(arguments), *_pages(arguments)]
    ended = run_up(_system_options(arguments, restart=True), arguments.base_port, operators)
    if arguments.no_record:
        print(f"{ended.verdict.outcome}: {ended.verdict.reason}; output in {ended.run_dir}")
        return int(ended.verdict.outcome != "completed")
    return _finish(ended, arguments, pictures=False, video=False)


def _finish(
    ended: "RunResult", arguments: argparse.Namespace, *, pictures: bool, video: bool
) -> int:
    """Sum up a run; the exit code is 0 only if it was completed."""
    from lab.review.report import finish

    if ended.verdict.outcome != "completed":
        # Before the log is read: if there is none, this is the reason.
        print(f"trill: {ended.verdict.outcome}: {ended.verdict.reason}", file=sys.stderr)
    settings = {
        "torque_mode": arguments.torque_mode or "as configured",
        "config": str(arguments.config or ""),
    }
    log = ended.run_dir / LOG_FILE
    summary = finish(log, ended.verdict, settings, pictures=pictures, video=video)
    if summary.outcome == "completed":
        return 0
    print(f"trill: failed: {summary.outcome}", file=sys.stderr)
    return 1


DEMO_ACTION = Action(DEMO, DEMO_EXAMPLES, _demo_arguments, _demo)
DRIVE_ACTION = Action(DRIVE, DRIVE_EXAMPLES, _drive_arguments, _drive)
UP_ACTION = Action(UP, UP_EXAMPLES, _up_arguments, _up)
