"""Player of scripts: each step is a generator that yields once a tick until it is done.

The steps share a :class:`ScriptContext`. Their only clock is its ``dt``, which is zero while the
plant is paused, so that a script waits with the robot.
"""

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from math import pi, sin

import numpy as np

from common.robot.pose import Pose
from common.robot.rotations import rotate, rotation_between
from common.schemas.arrays import Float64Array as Array
from services.teleop.scripted.gaits import GaitClient
from services.teleop.scripted.script import (
    Grip,
    HandPose,
    Mark,
    Move,
    Neck,
    Sine,
    Step,
    Together,
    Wait,
    Walk,
    axis_vector,
)
from services.teleop.targets.hand import SIDES, HandTarget, minimum_jerk
from services.teleop.targets.targets import OperatorTargets

log = logging.getLogger(__name__)

PEAK_OF_MINIMUM_JERK = 1.875
"""Peak speed / mean speed of a minimum-jerk path: 30/16 (Flash and Hogan 1985)."""
SPEED_USED = 0.95
"""Share of the speed limits that a path uses."""
FADE = 0.25
"""Share of a swing's duration in which it fades in, and in which it fades out."""


@dataclass
class ScriptContext:
    """State that the steps of a script share.

    Attributes:
        targets: of hands, grippers and neck.
        gaits: gait requests and their replies.
        dt: time since the last tick [s]; 0 while the plant is paused.
        label: of the last mark.
    """

    targets: OperatorTargets
    gaits: GaitClient
    dt: float = 0.0
    label: str = ""


def play(steps: Sequence[Step], context: ScriptContext) -> Iterator[None]:
    """Run ``steps`` one after another.

    Raises:
        ScriptError: a gait was refused too often, not answered or aborted.
    """
    for step in steps:
        yield from _step(step, context)


def _step(step: Step, context: ScriptContext) -> Iterator[None]:
    match step:
        case Wait():
            yield from _wait(step.seconds, context)
        case Move():
            yield from _move(step, context)
        case Sine():
            yield from _swing(step, context)
        case Grip():
            yield from _grip(step, context)
        case Neck():
            yield from _look(step, context)
        case Walk():
            for _ in range(step.count):
                yield from context.gaits.perform(step.gait)
        case Mark():
            context.label = step.label
            log.info("%s", step.label)
        case Together():
            yield from _together(step, context)


def _wait(seconds: float, context: ScriptContext) -> Iterator[None]:
    elapsed = 0.0
    while elapsed < seconds:
        yield
        elapsed += context.dt


def _together(step: Together, context: ScriptContext) -> Iterator[None]:
    lanes = [play(lane, context) for lane in step.lanes]
    while lanes := [lane for lane in lanes if next(lane, _DONE) is not _DONE]:
        yield


_DONE = object()


@dataclass
class _Path:
    """Minimum-jerk path of one hand from its target to a pose."""

    hand: HandTarget
    pose: HandPose
    start: Array = field(init=False)
    start_quaternion: Array = field(init=False)
    displacement: Array = field(init=False)
    rotation: Array = field(init=False)

    def __post_init__(self) -> None:
        hand = self.hand
        self.start, self.start_quaternion = hand.position, hand.quaternion
        self.displacement = np.array(self.pose.position) - self.start
        quaternion = self.pose.quaternion()
        self.rotation = (
            np.zeros(3)
            if quaternion is None
            else rotation_between(self.start_quaternion, quaternion)
        )

    def shortest(self) -> float:
        """Return the shortest duration within the hand's speed limits [s]."""
        limits = self.hand.limits
        linear = float(np.linalg.norm(self.displacement)) / limits.linear_speed
        angular = float(np.linalg.norm(self.rotation)) / limits.angular_speed
        return PEAK_OF_MINIMUM_JERK / SPEED_USED * max(linear, angular)

    def place_hand(self, phase: float) -> None:
        """Move the hand's target to its place after a share ``phase`` of the path's time."""
        share = minimum_jerk(phase)
        self.hand.place(
            Pose(
                self.start + share * self.displacement,
                rotate(self.start_quaternion, share * self.rotation),
            )
        )


def _move(step: Move, context: ScriptContext) -> Iterator[None]:
    poses = {"left": step.left, "right": step.right}
    paths = [
        _Path(context.targets.hands[side], pose) for side, pose in poses.items() if pose is not None
    ]
    duration = max(step.duration, *(path.shortest() for path in paths))
    elapsed = 0.0
    while elapsed < duration:
        yield
        elapsed += context.dt
        for path in paths:
            path.place_hand(min(1.0, elapsed / duration))


def _swing(step: Sine, context: ScriptContext) -> Iterator[None]:
    hand = context.targets.hands[step.hand]
    centre, quaternion, axis = hand.position, hand.quaternion, axis_vector(step.axis)
    fade, elapsed = FADE * step.duration, 0.0
    while elapsed < step.duration:
        yield
        elapsed = min(step.duration, elapsed + context.dt)
        envelope = min(1.0, elapsed / fade, (step.duration - elapsed) / fade)
        offset = envelope * step.amplitude * sin(2 * pi * step.frequency * elapsed)
        hand.place(Pose(centre + offset * axis, quaternion))


def _grip(step: Grip, context: ScriptContext) -> Iterator[None]:
    targets = context.targets
    asked = {"left": step.left, "right": step.right}
    for side, closure in asked.items():
        if closure is not None:
            targets.grip(side, closure)
    used = [SIDES.index(side) for side, closure in asked.items() if closure is not None]
    while not np.array_equal(targets.closure[used], targets.goal_closure[used]):
        yield


def _look(step: Neck, context: ScriptContext) -> Iterator[None]:
    context.targets.look(step.pitch)
    while context.targets.neck != context.targets.goal_neck:
        yield
