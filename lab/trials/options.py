"""Command-line options about trials, which several commands share."""

import argparse
from collections.abc import Callable
from typing import Any

from lab.trials.operators.specs import SyntheticSpec
from services.teleop.synthetic.traits import TRAITS

_LINK_HELP = (
    "delay a link: command, feedback, both or a topic, for instance both=250ms (see: trill latency "
    "--help); replaces the task's own link (hardware/ tasks: command=paper); none: no delay"
)


def whole_number(low: int, high: int | None = None) -> Callable[[str], int]:
    """Return a parser of numbers from ``low`` to ``high``, for ``type=`` of an option."""
    limits = f"from {low} up" if high is None else f"from {low} to {high}"

    def parse(text: str) -> int:
        if not text.isdecimal() or int(text) < low or (high is not None and int(text) > high):
            raise argparse.ArgumentTypeError(f"expected a number {limits}, got {text!r}")
        return int(text)

    return parse


count, seed = whole_number(1), whole_number(0)


def seed_range(text: str) -> range:
    """Parse ``7`` or ``0:25``; the end is not included.

    Raises:
        argparse.ArgumentTypeError: it is neither.
    """
    first, colon, last = text.partition(":")
    try:
        seeds = range(int(first), int(last) if colon else int(first) + 1)
    except ValueError:
        seeds = range(0)
    if not seeds or seeds.start < 0:
        raise argparse.ArgumentTypeError(f"expected a seed or a range like 0:25, got {text!r}")
    return seeds


def add_executor_options(parser: "argparse._ActionsContainer", default_jobs: str) -> None:
    """Add ``--jobs`` and ``--ray``, which choose the workers."""
    parser.add_argument(
        "--jobs",
        type=count,
        metavar="N",
        help=f"trials at a time, a process each ({default_jobs}; with --ray: as many as the "
        "cluster has processors)",
    )
    parser.add_argument(
        "--ray",
        metavar="ADDRESS",
        help="run the trials on a Ray cluster: auto, HOST:PORT or ray://HOST:PORT",
    )


def add_trial_options(parser: "argparse._ActionsContainer", physics_steps: int = 1) -> None:
    """Add the options of :class:`~lab.trials.spec.TrialSettings`, with the synthetic operator.

    Args:
        parser: a parser or a group of options.
        physics_steps: default of ``--physics-steps``.
    """
    parser.add_argument(
        "--traits",
        choices=list(TRAITS),
        default="practised",
        help="kind of synthetic operator: practised (default); steady, without tremor or aiming "
        "errors; jostled, whose hands are knocked off their way now and then and come back",
    )
    add_robot_options(parser, physics_steps)


def add_robot_options(parser: "argparse._ActionsContainer", physics_steps: int = 1) -> None:
    """Add the options of :class:`~lab.trials.spec.TrialSettings` but for the operator's.

    Args:
        parser: a parser or a group of options.
        physics_steps: default of ``--physics-steps``.
    """
    parser.add_argument(
        "--torque-mode",
        choices=["relaxed", "rated"],
        default="relaxed",
        help="torque limits: relaxed (default), or rated, the real motors'",
    )
    parser.add_argument(
        "--pace",
        choices=["fast", "normal", "slow", "public"],
        default="",
        help="pace of the gaits (default: normal; rated: slow)",
    )
    parser.add_argument(
        "--physics-steps",
        type=int,
        choices=range(1, 11),
        default=physics_steps,
        metavar="N",
        help="physics steps of 1 ms in one step of the plant, 1 to 10; more is faster, but the "
        f"robot hears commands later ({physics_steps})",
    )
    parser.add_argument(
        "--task-spread",
        type=float,
        default=1.0,
        metavar="FACTOR",
        help="factor on what the starts of the task vary by (1)",
    )


def add_link_options(parser: "argparse._ActionsContainer") -> None:
    """Add ``--link`` and ``--raw-hands``, what is between operator and robot."""
    parser.add_argument("--link", action="append", default=[], metavar="NAME=SPEC", help=_LINK_HELP)
    parser.add_argument(
        "--raw-hands",
        action="store_true",
        help="the controller does not interpolate the hand set-points",
    )


def trial_settings(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the fields of :class:`~lab.trials.spec.TrialSettings` from parsed options."""
    operator = SyntheticSpec(traits=TRAITS[arguments.traits])
    return {"operator": operator} | robot_settings(arguments)


def robot_settings(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return these fields but for the operator."""
    return {
        "torque_mode": arguments.torque_mode,
        "pace": arguments.pace,
        "physics_steps": arguments.physics_steps,
        "task_spread": arguments.task_spread,
    }
