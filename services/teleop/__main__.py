"""``python -m services.teleop scripted|keyboard|headset|synthetic``: an operator as a process."""

import argparse
import signal
import sys
from collections.abc import Callable
from types import FrameType
from typing import TypeVar

from pydantic import BaseModel

from common.packages import require
from common.runtime.live.main import OptionFormatter, run_live
from common.runtime.service import Service
from common.schemas import Gait
from common.tables import validated
from services.teleop.headset.config import PACKAGES, add_page_options, page_config
from services.teleop.headset.service import HeadsetOperator
from services.teleop.keyboard.config import KeyboardConfig
from services.teleop.keyboard.screen import help_lines
from services.teleop.keyboard.service import KeyboardOperator
from services.teleop.keyboard.terminal import Terminal
from services.teleop.scripted.library import SCRIPTS, ScriptOptions, script_named
from services.teleop.scripted.script import GAIT_NAMES
from services.teleop.scripted.service import ScriptedConfig, ScriptedOperator
from services.teleop.synthetic.service import SyntheticConfig, SyntheticOperator
from services.teleop.synthetic.strategies import STRATEGIES
from services.teleop.synthetic.traits import TRAITS

USAGE = """usage: python -m services.teleop {scripted,keyboard,headset,synthetic} [options]

Run an operator: it sends hand, gripper and neck set-points at 20 Hz, and gait requests.

  scripted   plays a script with the robot's feedback, then exits: 0 if it succeeded
  keyboard   is a person at this terminal, also over ssh and in tmux
  headset    is a person in a browser or a WebXR headset
  synthetic  does a scored task through the same input as a headset, then exits

The robot's side (plant and controller) runs in processes of its own, started before or after.
`python -m services.teleop scripted --help` (or `keyboard --help`) lists the options.
"""

SCRIPTED = """Play a script: wait until the controller balances, then move hands, grippers and neck
and request gaits, step by step. The exit code is 0 if the script succeeded, 1 if it failed (the
last line gives the reason), 2 if an option is wrong."""

SCRIPTED_EXAMPLES = """examples:
  python -m services.teleop scripted                                   the demo, about a minute
  python -m services.teleop scripted --script stand --seconds 60
  python -m services.teleop scripted --script gaits --gait turn_left --count 10
  python -m services.teleop scripted --script random --count 20 --seed 3
  python -m services.teleop scripted --script wave.json

A script file is an object with a "name" and a list of "steps"; hand positions are in metres in the
body frame (torso_link, x forward, y left, z up), rotations are roll, pitch, yaw in radians from a
hand pointing ahead:

  {"name": "wave", "steps": [
    {"do": "move", "left": {"position": [0.42, 0.22, 0.2], "rotation": [0, 0, 0]}, "duration": 2},
    {"do": "sine", "hand": "left", "axis": "y", "amplitude": 0.06, "frequency": 0.5, "duration": 4},
    {"do": "together", "lanes": [[{"do": "gait", "gait": "forward", "count": 2}],
                                 [{"do": "grip", "right": 1.0}, {"do": "neck", "pitch": 0.3}]]},
    {"do": "wait", "seconds": 1}, {"do": "mark", "label": "done"}]}
"""

SYNTHETIC = """Do a scored task as a person with a headset and two hand controllers would: observe
the robot and the objects through the feedback link, react, reach, press buttons, wait and correct.
The plant must run the same task (python -m services.sim --task ...). The exit code is 0 if the
operator completed its plan, 1 if it gave up (the last line gives the reason), 2 if an option is
wrong. The plant reports on task/status whether the task was a success."""

SYNTHETIC_EXAMPLES = """examples:
  python -m services.teleop synthetic --task door/unlock --seed 3
  python -m services.teleop synthetic --task bench/hammer --link feedback=250ms
  python -m services.teleop synthetic --task door/walk --stay      a new trial after each reset
"""

KEYBOARD = """Operate the robot from this terminal. A key press moves the hands smoothly by 2 cm or
5 degrees. Enter takes the robot, also from a script, and gives it back; while nobody has it, the
first key that moves the robot takes it. Until then this operator only watches. One press of x,
Backspace or Delete is the emergency stop, at any time and in any keyboard layout; b b ends it. A
gait requested while the robot walks is refused, and the screen shows it."""

HEADSET = """Operate the robot from a browser or a WebXR headset. A page is served at the link that
is printed. It shows the robot's stereo pictures. On a desktop, the pointer drags the hands and the
keys are those of the keyboard operator. In a headset, a hand follows its controller while the
squeeze (grip) button is held. Only this machine reaches the page unless --lan is given, which
serves it over HTTPS to the whole network."""

M = TypeVar("M", bound=BaseModel)


class _Formatter(OptionFormatter, argparse.RawDescriptionHelpFormatter):
    """Help formatter that shows defaults and keeps the layout of the examples."""


def _scripted_arguments(parser: argparse.ArgumentParser) -> None:
    parser.prog = "python -m services.teleop scripted"
    parser.epilog, parser.formatter_class = SCRIPTED_EXAMPLES, _Formatter
    default = ScriptOptions()
    group = parser.add_argument_group("script")
    group.add_argument("--script", default="demo", help=f"{', '.join(SCRIPTS)}, or a JSON file")
    group.add_argument(
        "--gait",
        choices=GAIT_NAMES,
        default=default.gait.name.lower(),
        help="of the script 'gaits'",
    )
    group.add_argument(
        "--count",
        type=_positive,
        default=default.count,
        help="number of gaits of 'gaits' and 'random'",
    )
    group.add_argument("--seed", type=int, default=default.seed, help="of the script 'random'")
    group.add_argument(
        "--seconds", type=_seconds, default=default.seconds, help="of the script 'stand'"
    )


def _synthetic_arguments(parser: argparse.ArgumentParser) -> None:
    parser.prog = "python -m services.teleop synthetic"
    parser.epilog, parser.formatter_class = SYNTHETIC_EXAMPLES, _Formatter
    group = parser.add_argument_group("operator")
    group.add_argument("--task", choices=list(STRATEGIES), help="task to do (door/unlock)")
    group.add_argument("--seed", type=int, help="seed of the operator's random variation (0)")
    group.add_argument(
        "--traits", choices=list(TRAITS), help="parameters of the operator (practised)"
    )
    group.add_argument(
        "--stay",
        action="store_true",
        help="wait for a reset of the plant after the task instead of ending",
    )
    group.add_argument(
        "--take-over",
        type=_seconds,
        metavar="S",
        help="let a policy begin, and take over from it when the robot has not moved for so long",
    )


def _keyboard_arguments(parser: argparse.ArgumentParser) -> None:
    parser.prog = "python -m services.teleop keyboard"
    parser.epilog = "\n".join(["keys:", *help_lines()])
    parser.formatter_class = _Formatter


def _headset_arguments(parser: argparse.ArgumentParser) -> None:
    parser.prog = "python -m services.teleop headset"
    parser.formatter_class = _Formatter
    add_page_options(parser)


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"expected at least 1, got {value}")
    return value


def _seconds(text: str) -> float:
    value = float(text)
    if not 0.0 < value <= 3600.0:
        raise argparse.ArgumentTypeError(f"expected more than 0 and at most 3600 s, got {value:g}")
    return value


def build_scripted(arguments: argparse.Namespace) -> ScriptedOperator:
    """Build the scripted operator; its table in the configuration file is ``[teleop]``.

    Raises:
        ConfigError: the table is wrong, or the script cannot be read.
    """
    config = validated(ScriptedConfig, arguments.settings)
    gait = Gait[arguments.gait.upper()]
    options = ScriptOptions(gait, arguments.count, arguments.seed, arguments.seconds)
    return ScriptedOperator(script_named(arguments.script, options), config)


def build_synthetic(arguments: argparse.Namespace) -> SyntheticOperator:
    """Build the synthetic operator; its table in the configuration file is ``[teleop]``.

    Raises:
        ConfigError: the table or an option is wrong.
    """
    given = {"task": arguments.task, "seed": arguments.seed, "stay": arguments.stay or None}
    given["traits"] = TRAITS[arguments.traits].model_dump() if arguments.traits else None
    given["take_over"] = {"stalled": arguments.take_over} if arguments.take_over else None
    options = {name: value for name, value in given.items() if value is not None}
    arguments.settings = {**arguments.settings, **options}
    return SyntheticOperator(validated(SyntheticConfig, arguments.settings))


def build_keyboard(arguments: argparse.Namespace) -> KeyboardOperator:
    """Build the keyboard operator; its table in the configuration file is ``[keyboard]``.

    Raises:
        ConfigError: the table is wrong.
        TerminalError: this process has no terminal.
    """
    return KeyboardOperator(Terminal(), validated(KeyboardConfig, arguments.settings))


def build_headset(arguments: argparse.Namespace) -> Service:
    """Build the operator in a browser; its table in the configuration file is ``[headset]``.

    Raises:
        ConfigError: the table or an option is wrong, or a package is missing.
        TeleopError: the page cannot be served.
    """
    require("the headset operator", "headset", *PACKAGES)
    from services.teleop.headset.serve import serve

    return serve(page_config(arguments, arguments.settings), new_token=arguments.new_token)


def _stop_on_hangup() -> None:
    """End the process in order, as SIGTERM does, when the terminal closes."""

    def stop(_number: int, _frame: FrameType | None) -> None:
        signal.raise_signal(signal.SIGTERM)

    signal.signal(signal.SIGHUP, stop)


def _run_scripted(argv: list[str]) -> int:
    return run_live(
        build_scripted,
        ScriptedOperator.name,
        argv,
        add_arguments=_scripted_arguments,
        description=SCRIPTED,
    )


def _run_keyboard(argv: list[str]) -> int:
    _stop_on_hangup()
    return run_live(
        build_keyboard,
        KeyboardOperator.name,
        argv,
        add_arguments=_keyboard_arguments,
        description=KEYBOARD,
    )


def _run_headset(argv: list[str]) -> int:
    return run_live(
        build_headset,
        HeadsetOperator.name,
        argv,
        add_arguments=_headset_arguments,
        description=HEADSET,
    )


def _run_synthetic(argv: list[str]) -> int:
    return run_live(
        build_synthetic,
        SyntheticOperator.name,
        argv,
        add_arguments=_synthetic_arguments,
        description=SYNTHETIC,
    )


MODES: dict[str, Callable[[list[str]], int]] = {
    "scripted": _run_scripted,
    "keyboard": _run_keyboard,
    "headset": _run_headset,
    "synthetic": _run_synthetic,
}


def main(argv: list[str] | None = None) -> int:
    """Run the operator that the first argument names; returns the exit code."""
    arguments = sys.argv[1:] if argv is None else argv
    if not arguments or arguments[0] in {"-h", "--help"}:
        print(USAGE)
        return 0 if arguments else 2
    mode, *rest = arguments
    run = MODES.get(mode)
    if run is None:
        *most, last = MODES
        expected = f"{', '.join(most)} or {last}"
        print(f"teleop: expected {expected}, got {mode!r}\n\n{USAGE}", file=sys.stderr)
        return 2
    return run(rest)


if __name__ == "__main__":
    raise SystemExit(main())
