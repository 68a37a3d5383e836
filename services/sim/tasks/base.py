"""What a task is: a scene, a seeded start, stages towards a goal, and what must not happen."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from common.robot.pose import Pose
from services.sim.config import NoiseConfig


class Touch(NamedTuple):
    """What touches what.

    Attributes:
        side: ``left``, ``right`` or empty, of a robot's part.
        part: the robot's part (``wrist``), or a thing of the scene.
        thing: of the scene, or ``floor``.
    """

    side: str
    part: str
    thing: str

    def __str__(self) -> str:
        return f"{self.side} {self.part} on {self.thing}".strip()


class Pair(NamedTuple):
    """A robot's part, on either side, and a thing."""

    part: str
    thing: str

    def __str__(self) -> str:
        return f"{self.part} on {self.thing}"


@dataclass(frozen=True, slots=True, eq=False)
class BodyState(Pose):
    """Pose of a body in the world, and its speed.

    Attributes:
        speed: of the body's origin [m/s].
    """

    speed: float = 0.0


@dataclass(frozen=True, slots=True)
class Snapshot:
    """What a judge sees at one tick.

    Attributes:
        time: since the start of the trial [s].
        robot: the torso.
        loads: (left, right) normal force of the feet [N].
        fallen: whether the robot has fallen.
        joints: hinges and slides of the scene [rad, m].
        objects: bodies the task watches.
        touches: what touched since the last tick, with the largest normal force [N].
    """

    time: float
    robot: BodyState
    loads: tuple[float, float]
    fallen: bool
    joints: Mapping[str, float] = field(default_factory=dict)
    objects: Mapping[str, BodyState] = field(default_factory=dict)
    touches: Mapping[Touch, float] = field(default_factory=dict)

    @property
    def standing(self) -> bool:
        """Whether it stands on both feet and hardly moves."""
        return min(self.loads) > STANDING_LOAD and self.robot.speed < STANDING_SPEED

    def touched(self, thing: str, *parts: str, side: str = "") -> bool:
        """Whether ``thing`` was touched by one of ``parts``, on this side if given.

        Args:
            thing: of the scene, or ``floor``.
            *parts: of the robot, or other things; none given: any part of the robot.
            side: ``left``, ``right`` or either.
        """
        wanted = frozenset(parts) or ROBOT_PARTS
        return any(
            (touch.thing == thing and touch.part in wanted and side in ("", touch.side))
            or (touch.part == thing and touch.thing in wanted)
            for touch in self.touches
        )


STANDING_LOAD = 30.0
"""A foot that bears less is not stood on [N]."""
STANDING_SPEED = 0.1
"""A torso faster than this is walking [m/s]."""
HAND = ("finger", "palm")
ROBOT_PARTS = frozenset(
    (
        *HAND,
        *("wrist", "forearm", "elbow", "upper arm", "shoulder", "head", "chest", "pelvis"),
        *("hip", "thigh", "knee", "shin", "foot"),
    )
)
"""The robot's parts, as people call them."""

Test = Callable[[Snapshot], bool]


@dataclass(frozen=True, slots=True)
class Stage:
    """A step towards the goal.

    Attributes:
        name: what then has been done.
        test: whether it is so now.
        hold: for how long without a break it must be so [s].
        after: the stage that must be done before, if any.
        counts: whether the task is partly done with it.
    """

    name: str
    test: Test
    hold: float = 0.0
    after: str = ""
    counts: bool = False


@dataclass(frozen=True, slots=True)
class FailureCondition:
    """An end that cannot be mended: ``name`` says what happened, ``test`` whether it did."""

    name: str
    test: Test
    hold: float = 0.0


@dataclass(frozen=True, slots=True)
class Start:
    """Where everything is when a trial starts.

    Attributes:
        x: of the torso in the world [m].
        y: [m].
        yaw: heading [rad].
        joints: ``qpos`` of the scene's joints by name; what is not named stays as built.
    """

    x: float
    y: float
    yaw: float
    joints: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Task:
    """A scored task.

    Attributes:
        name: ``<group>/<task>``.
        scene: where it takes place.
        goal: what to do, in one sentence.
        rule: when it is a success, in words.
        limit: time limit [s].
        start: draws the start of a trial.
        stages: in order; the last is the goal.
        wrongs: what ends the trial at once.
        desired: contacts the task asks for or bears; every other one between robot and scene is
            undesired.
        objects: of the scene, to report; the judge sees those that are bodies, not the sites.
        joints: hinges and slides of the scene to watch and to report.
        marks: places that do not move; ``goal`` among them.
        noise: of the measured state, unless the plant's configuration says otherwise.
        link: delay on the way from operator to robot that belongs to the task, unless links are
            given, see :attr:`links`; empty: none.
        origin: where start and rule are from.
    """

    name: str
    scene: str
    goal: str
    rule: str
    limit: float
    start: Callable[[np.random.Generator], Start]
    stages: tuple[Stage, ...]
    marks: Mapping[str, Pose]
    wrongs: tuple[FailureCondition, ...] = ()
    desired: frozenset[Pair] = frozenset()
    objects: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    link: str = ""
    origin: str = ""

    @property
    def links(self) -> dict[str, str]:
        """Its own link by name; empty: none."""
        return {"command": self.link} if self.link else {}


def pairs(parts: tuple[str, ...], *things: str) -> frozenset[Pair]:
    """Every part with every thing."""
    return frozenset(Pair(part, thing) for part in parts for thing in things)


def normal(rng: np.random.Generator, mean: float, deviation: float) -> float:
    """A normal variate within 2.5 deviations of its mean, so that no start is absurd."""
    return mean + deviation * float(np.clip(rng.normal(), -2.5, 2.5))


def spread(rng: np.random.Generator, mean: float, half: float) -> float:
    """A uniform variate within ``half`` of ``mean``."""
    return mean + half * float(rng.uniform(-1.0, 1.0))


def free_joint(x: float, y: float, z: float, yaw: float = 0.0) -> tuple[float, ...]:
    """``qpos`` of a free joint that stands upright [m, rad]."""
    return (x, y, z, math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw))
