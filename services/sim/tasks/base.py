"""Definition of a scored task: scene, seeded start, stages, failures and permitted contacts."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from common.robot.pose import Pose
from services.sim.config import NoiseConfig

STANDING_LOAD = 30.0
"""Normal force above which a foot counts as standing [N]."""
STANDING_SPEED = 0.1
"""Torso speed below which the robot counts as standing [m/s]."""
HAND = ("finger", "palm")
ROBOT_PARTS = frozenset(
    (
        *HAND,
        *("wrist", "forearm", "elbow", "upper arm", "shoulder", "head", "chest", "pelvis"),
        *("hip", "thigh", "knee", "shin", "foot"),
    )
)
"""Names of the robot's parts in contacts."""


class Contact(NamedTuple):
    """A contact of a part of the robot with an object, or of two objects.

    Attributes:
        side: ``left`` or ``right`` for a part of the robot that has a side; else empty.
        part: the robot's part (``wrist``), or an object of the scene.
        object: an object of the scene, or ``floor``.
    """

    side: str
    part: str
    object: str

    def __str__(self) -> str:
        return f"{self.side} {self.part} on {self.object}".strip()


class ContactPair(NamedTuple):
    """A part of the robot, on either side, and an object."""

    part: str
    object: str

    def __str__(self) -> str:
        return f"{self.part} on {self.object}"


def contact_pairs(parts: tuple[str, ...], *objects: str) -> frozenset[ContactPair]:
    """Return every combination of ``parts`` and ``objects``."""
    return frozenset(ContactPair(part, name) for part in parts for name in objects)


@dataclass(frozen=True, slots=True, eq=False)
class BodyState(Pose):
    """Pose of a body in the world, and its speed.

    Attributes:
        speed: of the body's origin [m/s].
    """

    speed: float = 0.0


class Measures(Protocol):
    """What can be measured of robot and scene as they are now."""

    def robot(self) -> BodyState:
        """Return pose and speed of the torso."""
        ...

    def loads(self) -> tuple[float, float]:
        """Return the normal force of the feet, left and right [N]."""
        ...

    def joints(self) -> Mapping[str, float]:
        """Return the positions of the scene's hinges and slides by name [rad, m]."""
        ...

    def objects(self) -> Mapping[str, BodyState]:
        """Return the states of the bodies that the task watches, by name."""
        ...


@dataclass(frozen=True)
class Snapshot:
    """State of robot and scene from which a trial is judged; it holds until physics goes on.

    A task asks for little of it, a hundred times a second, so that the rest is not measured.

    Attributes:
        time: since the start of the trial [s].
        fallen: whether the robot has fallen.
        contacts: contacts since the previous snapshot, with the largest normal force [N].
        measures: measures the rest when it is first asked for.
    """

    time: float
    fallen: bool
    contacts: Mapping[Contact, float]
    measures: Measures

    @cached_property
    def robot(self) -> BodyState:
        """Pose and speed of the torso."""
        return self.measures.robot()

    @cached_property
    def loads(self) -> tuple[float, float]:
        """Normal force of the feet, left and right [N]."""
        return self.measures.loads()

    @cached_property
    def joints(self) -> Mapping[str, float]:
        """Positions of the scene's hinges and slides by name [rad, m]."""
        return self.measures.joints()

    @cached_property
    def objects(self) -> Mapping[str, BodyState]:
        """States of the bodies that the task watches, by name."""
        return self.measures.objects()

    @property
    def standing(self) -> bool:
        """Whether the robot stands on both feet and hardly moves."""
        return min(self.loads) > STANDING_LOAD and self.robot.speed < STANDING_SPEED

    def touched(self, name: str, *parts: str, side: str = "") -> bool:
        """Return whether an object was touched.

        Args:
            name: object of the scene, or ``floor``.
            *parts: parts of the robot, or other objects; none: any part of the robot.
            side: ``left`` or ``right``; empty: either.
        """
        wanted = frozenset(parts) or ROBOT_PARTS
        return any(
            (contact.object == name and contact.part in wanted and side in ("", contact.side))
            or (contact.part == name and contact.object in wanted)
            for contact in self.contacts
        )


Condition = Callable[[Snapshot], bool]


@dataclass(frozen=True, slots=True)
class Stage:
    """A step towards a task's goal.

    Attributes:
        name: what is achieved with it.
        test: condition on the snapshot.
        hold: time for which the condition must hold without a break [s].
        after: name of the stage that must be done before; empty: none.
        partial: whether the stage makes a trial a partial success.
    """

    name: str
    test: Condition
    hold: float = 0.0
    after: str = ""
    partial: bool = False


@dataclass(frozen=True, slots=True)
class FailureCondition:
    """An event that ends a trial as a failure.

    Attributes:
        name: what happened.
        test: condition on the snapshot.
        hold: time for which the condition must hold without a break [s].
    """

    name: str
    test: Condition
    hold: float = 0.0


@dataclass(frozen=True, slots=True)
class Start:
    """Start of a trial.

    Attributes:
        x: of the torso in the world [m].
        y: of the torso in the world [m].
        yaw: heading of the torso [rad].
        joints: ``qpos`` of the scene's joints by name; the others keep their default.
    """

    x: float
    y: float
    yaw: float
    joints: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Draw:
    """Draws the numbers of a start.

    Attributes:
        rng: source of randomness.
        width: factor on what they vary by.
    """

    rng: np.random.Generator
    width: float = 1.0

    def normal(self, mean: float, deviation: float) -> float:
        """Draw from a normal distribution that is cut off at 2.5 standard deviations."""
        return mean + self.width * deviation * float(np.clip(self.rng.normal(), -2.5, 2.5))

    def uniform(self, mean: float, half: float) -> float:
        """Draw uniformly from ``mean`` ± ``half``."""
        return mean + self.width * half * float(self.rng.uniform(-1.0, 1.0))


@dataclass(frozen=True, slots=True)
class Task:
    """A scored task.

    Attributes:
        name: ``<group>/<task>``.
        scene: name of its scene.
        goal: instruction in one sentence.
        rule: condition of success in words.
        limit: time limit [s].
        start: draws the start of a trial.
        stages: in order; the last one is the goal.
        failures: events that end a trial at once.
        desired: contacts that the task needs or tolerates; every other contact between robot and
            scene is undesired.
        objects: bodies and sites of the scene to report; trials are judged by the bodies only.
        joints: hinges and slides of the scene to watch and to report.
        marks: fixed poses in the world; ``goal`` is one of them.
        noise: on the measured state, unless the plant's configuration sets another.
        link: delay between operator and robot that belongs to the task; empty: none.
        origin: source of start and rule.
    """

    name: str
    scene: str
    goal: str
    rule: str
    limit: float
    start: Callable[[Draw], Start]
    stages: tuple[Stage, ...]
    marks: Mapping[str, Pose]
    failures: tuple[FailureCondition, ...] = ()
    desired: frozenset[ContactPair] = frozenset()
    objects: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    link: str = ""
    origin: str = ""

    @property
    def links(self) -> dict[str, str]:
        """Delay of the task's own link by the link's name; empty: none."""
        return {"command": self.link} if self.link else {}


def free_joint(x: float, y: float, z: float, yaw: float = 0.0) -> tuple[float, ...]:
    """Return ``qpos`` (7,) of a free joint of an upright body [m, rad]."""
    return (x, y, z, math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw))
