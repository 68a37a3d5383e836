"""Built-in scripts."""

import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from common.errors import ConfigError
from common.schemas import Gait
from services.teleop.scripted.script import (
    Grip,
    HandPose,
    Mark,
    Move,
    Neck,
    Script,
    Sine,
    Step,
    Together,
    Wait,
    Walk,
    load_script,
)
from services.teleop.targets.hand import HOME_POSITION

HOME: Final = HandPose(position=HOME_POSITION)
REACH: Final = HandPose(position=(0.42, 0.22, 0.08))
REACH_HIGH: Final = HandPose(position=(0.42, 0.22, 0.25))
ROLLED: Final = HandPose(position=(0.36, 0.24, 0.06), rotation=(0.8, 0.0, 0.0))
REACH_DOWN: Final = HandPose(position=(0.40, 0.20, 0.02), rotation=(0.0, 0.3, 0.0))


@dataclass(frozen=True)
class ScriptOptions:
    """Parameters of the built-in scripts.

    Attributes:
        gait: for ``gaits``.
        count: number of gaits, for ``gaits`` and ``random``.
        seed: for ``random``.
        seconds: for ``stand``.
    """

    gait: Gait = Gait.FORWARD
    count: int = 5
    seed: int = 0
    seconds: float = 20.0


def both(pose: HandPose, duration: float) -> Move:
    """Return the move of the left hand to ``pose`` and of the right one to its mirror image."""
    return Move(left=pose, right=pose.mirrored(), duration=duration)


def _swing(hand: Literal["left", "right"], axis: Literal["x", "y", "z"], seconds: float) -> Sine:
    return Sine(hand=hand, axis=axis, amplitude=0.06, duration=seconds)


def _start() -> tuple[Step, ...]:
    return (Mark(label="hands home"), both(HOME, 1.5), Wait(seconds=1.0))


def _reach_and_grip() -> tuple[Step, ...]:
    return (
        Mark(label="both hands reach forward"),
        Together(lanes=((both(REACH, 2.0),), (Neck(pitch=0.3),))),
        Mark(label="grippers close and open"),
        Grip(left=1.0, right=1.0),
        Wait(seconds=0.5),
        Grip(left=0.0, right=0.0),
        Mark(label="one hand high, then the other"),
        Move(left=REACH_HIGH, right=HOME.mirrored(), duration=2.0),
        Move(left=HOME, right=REACH_HIGH.mirrored(), duration=2.5),
        Mark(label="hands roll outward and home"),
        both(ROLLED, 2.0),
        both(HOME, 2.0),
    )


def demo(_options: ScriptOptions) -> Script:
    """Return the demo: all gaits, hands moving while standing and walking, grippers, a reach."""
    while_walking = (
        Mark(label="walk forward, hands at rest"),
        Walk(gait=Gait.FORWARD),
        Mark(label="walk forward, hands swinging"),
        Together(
            lanes=(
                (Walk(gait=Gait.FORWARD),),
                (_swing("left", "z", 4.0),),
                (_swing("right", "y", 4.0),),
            )
        ),
        Mark(label="turn left twice, right hand reaching"),
        Together(
            lanes=(
                (Walk(gait=Gait.TURN_LEFT, count=2),),
                (
                    Move(right=REACH.mirrored(), duration=2.0),
                    Grip(right=1.0),
                    Move(right=HOME.mirrored(), duration=2.0),
                ),
            )
        ),
        Mark(label="side-step left, then right, left hand swinging"),
        Together(
            lanes=(
                (Walk(gait=Gait.SIDE_LEFT), Walk(gait=Gait.SIDE_RIGHT)),
                (_swing("left", "x", 5.0),),
            )
        ),
        Mark(label="turn right twice, right gripper opens"),
        Together(lanes=((Walk(gait=Gait.TURN_RIGHT, count=2),), (Grip(right=0.0),))),
        Mark(label="walk backward"),
        Walk(gait=Gait.BACKWARD, count=2),
    )
    return Script(
        name="demo",
        steps=(
            *_start(),
            *_reach_and_grip(),
            Mark(label="hands swing, standing"),
            Together(lanes=((_swing("left", "z", 4.0),), (_swing("right", "y", 4.0),))),
            *while_walking,
            Mark(label="reach down, pitched"),
            both(REACH_DOWN, 2.5),
            Wait(seconds=1.0),
            Together(lanes=((both(HOME, 2.0),), (Neck(pitch=0.0),))),
            Mark(label="done"),
            Wait(seconds=1.0),
        ),
    )


def stand(options: ScriptOptions) -> Script:
    """Return a script that stands for ``seconds`` with swinging hands."""
    half = options.seconds / 2
    return Script(
        name="stand",
        steps=(
            *_start(),
            Mark(label="stand, hands swinging"),
            Together(lanes=((_swing("left", "z", half),), (_swing("right", "y", half),))),
            Together(lanes=((_swing("left", "y", half),), (_swing("right", "x", half),))),
        ),
    )


def gaits(options: ScriptOptions) -> Script:
    """Return a script of one gait, ``count`` times, with hands at rest."""
    name = options.gait.name.lower()
    walks: list[Step] = []
    for number in range(1, options.count + 1):
        walks += [Mark(label=f"{name} {number}/{options.count}"), Walk(gait=options.gait)]
    return Script(name="gaits", steps=(*_start(), *walks))


def random_walk(options: ScriptOptions) -> Script:
    """Return a script of ``count`` random gaits with moving hands, determined by the seed."""
    draw = random.Random(options.seed)
    moving: list[Step] = []
    for number in range(1, options.count + 1):
        gait = draw.choice([gait for gait in Gait if gait is not Gait.NONE])
        hands = Move(left=_pose(draw), right=_pose(draw).mirrored(), duration=2.0)
        moving += [
            Mark(label=f"{gait.name.lower()} {number}/{options.count}"),
            Together(lanes=((Walk(gait=gait),), (hands,))),
        ]
    return Script(name="random", steps=(*_start(), *moving, both(HOME, 2.0)))


def _pose(draw: random.Random) -> HandPose:
    """Draw a pose of the left hand in a box that is reachable everywhere."""
    return HandPose(
        position=(draw.uniform(0.28, 0.38), draw.uniform(0.20, 0.29), draw.uniform(-0.02, 0.08)),
        rotation=(draw.uniform(0.0, 0.3), draw.uniform(0.0, 0.25), draw.uniform(-0.1, 0.0)),
    )


SCRIPTS: Final[dict[str, Callable[[ScriptOptions], Script]]] = {
    "demo": demo,
    "stand": stand,
    "gaits": gaits,
    "random": random_walk,
}
"""Built-in scripts by name."""


def script_named(name: str, options: ScriptOptions) -> Script:
    """Return the built-in script ``name``, or the script in the JSON file of that path.

    Raises:
        ConfigError: the name is unknown, or the file is not a script.
    """
    build = SCRIPTS.get(name)
    if build is not None:
        return build(options)
    path = Path(name)
    if path.suffix != ".json":
        raise ConfigError(f"--script: expected {', '.join(SCRIPTS)} or a .json file, got {name!r}")
    return load_script(path)
