"""Manipulation skills of the synthetic operator: reaches, grasps, steady pushes.

The operator knows its own hands without delay, and the robot's only from what it observes: a hand
is expected where it was last seen at rest, plus the motion of the own hand since. After each reach
the operator waits until the robot's hand is seen there, or at rest elsewhere, and then corrects.
With delayed observations it moves and waits, as people do.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from common.robot.pose import Pose
from common.robot.rotations import rotate, rotation_between
from common.schemas.arrays import Float64Array as Array
from services.teleop.synthetic.body import Act, Condition, OperatorBody
from services.teleop.synthetic.observation import Observation
from services.teleop.synthetic.traits import OperatorTraits
from services.teleop.targets.hand import SIDES

Goal = Callable[[Observation], Pose]
"""Function from an observation to the desired pose of a hand in the body frame."""
Approach = Callable[[Observation, float], Pose]
"""Function from an observation and a distance ahead of a grasp [m] to the pose of the hand."""

_ONSET = 0.025
"""Distance after which a hand's motion is visible [m]."""
_CORRECTION = 0.05
"""Largest correction, so that a blocked hand is not sent ever further [m]."""
_LONGEST_WAIT = 6.0
"""Longest wait for a hand to come to rest [s]."""
_STEER = 1.0
"""Gain with which a pushing hand is brought back to its line [1/s]."""
_RAMP = 0.3
"""Time in which a push reaches its speed [s]."""


@dataclass
class _Anchor:
    """Pose in which the robot's hand was seen at rest, and the own hand's pose then."""

    seen: Pose
    position: Array
    quaternion: Array


@dataclass
class _Onset:
    """A reach that is not yet visible.

    Attributes:
        own: (3,) position of the own hand before [m].
        seen: (3,) position of the robot's hand before [m].
        felt: time at which the own hand had moved visibly [s]; None: not yet.
    """

    own: Array
    seen: Array
    felt: float | None = None


class Manipulation(OperatorBody):
    """An operator that can handle objects with the robot's hands.

    Attributes:
        lag: estimated delay from an own motion until it is seen [s].
    """

    def __init__(self, traits: OperatorTraits, rng: np.random.Generator, seen: Observation) -> None:
        super().__init__(traits, rng, seen)
        self.lag = 0.1
        self._anchors = {s: self._anchored(s) for s in SIDES}
        self._onsets: dict[str, _Onset] = {}

    def observe(self, seen: Observation, time: float, dt: float) -> None:
        """Take in an observation and estimate the lag from it."""
        super().observe(seen, time, dt)
        for side in SIDES:
            self._estimate_lag(side)

    def engage(self, *sides: str) -> Act:
        """Squeeze the clutches and note the poses of the robot's hands."""
        for side in sides:
            self.own_hands[side].squeeze = 1.0
        yield from self.pause(2.0 * self.dt)
        for side in sides:
            self._anchors[side] = self._anchored(side)
        return True

    def expected(self, side: str) -> Pose:
        """Return the expected pose of a hand of the robot in the body frame."""
        anchor, own = self._anchors[side], self.own_hands[side]
        turn = rotation_between(anchor.quaternion, own.quaternion)
        return Pose(
            anchor.seen.position + own.position - anchor.position,
            rotate(anchor.seen.quaternion, turn),
        )

    def reach(
        self,
        side: str,
        goal: Goal,
        *,
        speed: float = 1.0,
        tolerance: float = 0.02,
        angle: float = 0.15,
        corrections: int = 3,
        until: Condition | None = None,
        through: bool = False,
    ) -> Act:
        """Move a hand to a goal, observe, and correct.

        It succeeds if the hand is seen within the tolerances, or if ``until`` is met.

        Args:
            side: ``left`` or ``right``.
            goal: evaluated again before each correction.
            speed: relative to the operator's usual speed.
            tolerance: of the position [m].
            angle: tolerance of the rotation [rad].
            corrections: largest number of corrections.
            until: condition that ends the reach after a reaction time.
            through: do not stop at the goal; the next reach goes on from there.
        """
        for attempt in range(1 + corrections):
            target = goal(self.seen)
            self._aim(side, target, speed, _CORRECTION if attempt else np.inf)
            ended = yield from self._watch(side, until)
            if ended or through:
                return True
            yield from self.settle(side)
            if until is not None and until(self.seen):
                return True
            seen, target = self.seen.hands[side], goal(self.seen)
            off = float(np.linalg.norm(target.position - seen.position))
            turned = float(np.linalg.norm(rotation_between(seen.quaternion, target.quaternion)))
            if off < tolerance and turned < angle:
                return True
            if attempt < corrections:
                yield from self.react()
        return False

    def _aim(self, side: str, target: Pose, speed: float, longest: float) -> None:
        traits, own, here = self.traits, self.own_hands[side], self.expected(side)
        shift = target.position - here.position
        turn = rotation_between(here.quaternion, target.quaternion)
        distance, angle = float(np.linalg.norm(shift)), float(np.linalg.norm(turn))
        if distance > longest:
            shift, distance = shift * (longest / distance), longest
        shift = shift + self.rng.normal(0.0, traits.aim_error * distance, 3)
        needed = max(distance / traits.reach_speed, angle / traits.turn_speed)
        duration = max(traits.shortest_reach, needed) / speed
        own.move(shift, turn, duration)
        self._onsets[side] = _Onset(own.position, self.seen.hands[side].position)

    def _watch(self, side: str, until: Condition | None) -> Act:
        """Wait for the end of a reach; succeeds if ``until`` is met before."""
        own = self.own_hands[side]
        while own.moving:
            yield
            if until is not None and until(self.seen):
                yield from self.react()
                own.stop()
                return True
        return False

    def _estimate_lag(self, side: str) -> None:
        """Average the time between the onsets of the own motion and of the robot's."""
        onset, own = self._onsets.get(side), self.own_hands[side]
        if onset is None:
            return
        if onset.felt is None and float(np.linalg.norm(own.position - onset.own)) > _ONSET:
            onset.felt = self.time
        moved = float(np.linalg.norm(self.seen.hands[side].position - onset.seen))
        if onset.felt is not None and moved > _ONSET:
            self.lag += 0.5 * (self.time - onset.felt - self.lag)
            del self._onsets[side]

    def settle(self, side: str) -> Act:
        """Wait until the robot's hand is seen where it is expected, or at rest elsewhere."""
        began, calm = self.time, 0.0
        while self.time - began < _LONGEST_WAIT:
            yield
            calm = calm + self.dt if self.hand_speed(side) < self.traits.still else 0.0
            seen, expected = self.seen.hands[side], self.expected(side)
            off = float(np.linalg.norm(expected.position - seen.position))
            turned = float(np.linalg.norm(rotation_between(seen.quaternion, expected.quaternion)))
            agrees = off < self.traits.agreement and turned < self.traits.agreement_angle
            if agrees and calm >= 2.0 * self.dt:
                break
            if self.time - began > self.lag + self.traits.patience and calm >= 0.3:
                break
        self._anchors[side] = self._anchored(side)
        return True

    def push(
        self,
        side: str,
        direction: Callable[[Observation], Array],
        distance: float,
        *,
        speed: float,
        until: Condition,
        lead: float = 0.07,
    ) -> Act:
        """Push with constant speed until a condition is met; succeeds if it is.

        Args:
            side: ``left`` or ``right``.
            direction: unit vector (3,) in the body frame.
            distance: largest distance [m].
            speed: [m/s].
            until: condition that ends the push after a reaction time.
            lead: distance ahead of the robot's hand at which the own hand waits [m].
        """
        own, gone, pace, blocked = self.own_hands[side], 0.0, 0.0, 0.0
        line = self.seen.hands[side].position
        while gone < distance and not until(self.seen):
            heading = direction(self.seen)
            ahead = self.expected(side).position - self.seen.hands[side].position
            room = float(ahead @ heading) < lead
            pace = min(speed, pace + speed * self.dt / _RAMP) if room else 0.0
            moved = self.seen.hands[side].position - line
            aside = moved - float(moved @ heading) * heading
            own.drive(pace * heading - _STEER * aside)
            yield
            gone += pace * self.dt
            blocked = 0.0 if room else blocked + self.dt
            if blocked > self.lag + 2.0 * self.traits.patience:
                break
        if until(self.seen):
            yield from self.react()
        own.stop()
        met = yield from self.wait_until(until, self.lag + self.traits.patience)
        return met

    def grip(self, side: str, closure: float) -> Act:
        """Move the trigger, and wait until the gripper should have followed."""
        own = self.own_hands[side]
        own.press_trigger(closure, self.traits.grip_time)
        while own.trigger_moving:
            yield
        yield from self.pause(self.lag + 0.3)
        return True

    def grasp(
        self, side: str, at: Approach, before: float, *, speed: float = 0.8, angle: float = 0.12
    ) -> Act:
        """Bring an open hand before an object and around it, and close the gripper.

        Args:
            side: ``left`` or ``right``.
            at: pose of the hand at a distance along the approach.
            before: distance of the hand before the object at first [m].
            speed: of the second reach, relative to the operator's usual speed.
            angle: tolerance of the rotation [rad].
        """
        yield from self.together(
            self.grip(side, 0.0),
            self.reach(side, lambda seen: at(seen, -before), tolerance=0.015, angle=angle),
        )
        yield from self.reach(
            side, lambda seen: at(seen, 0.0), speed=speed, tolerance=0.012, angle=angle
        )
        self.note = "gripping"
        yield from self.react()
        yield from self.grip(side, 1.0)
        return True

    def _anchored(self, side: str) -> _Anchor:
        own = self.own_hands[side]
        return _Anchor(self.seen.hands[side], own.position, own.quaternion)
