"""Handling things: reaches, steady pushes, grips.

The operator knows its own hands without delay and the robot's only from what it sees: a hand is
expected where it was last seen at rest plus what the own hand has moved since. After each reach it
waits until what it sees agrees, or until the robot's hand has come to rest elsewhere, and then
corrects: with a delayed picture it moves and waits, as people do.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from common.robot.pose import Pose
from common.robot.rotations import rotate, rotation_between
from common.schemas.arrays import Float64Array as Array
from services.teleop.synthetic.body import Act, Body, Sign
from services.teleop.synthetic.sight import Sight
from services.teleop.synthetic.traits import OperatorTraits
from services.teleop.targets.hand import SIDES

Goal = Callable[[Sight], Pose]
"""Where a hand should be, in the body frame, by what is seen."""

_ONSET = 0.025
"""A hand that has moved this far has visibly moved [m]."""
_CORRECTION = 0.05
"""A hand that does not get nearer is not sent ever further [m]."""
_LONGEST_WAIT = 6.0
_STEER = 1.0
"""How quickly a hand that strays from its line is brought back [1/s]."""
_RAMP = 0.3
"""Time in which a steady push gets up to speed [s]."""


@dataclass
class _Anchor:
    """Where the robot's hand was seen at rest, and the own hand with it."""

    seen: Pose
    position: Array
    quaternion: Array


@dataclass
class _Onset:
    """A reach that has not been seen to begin: own and seen hand before it, when it was felt."""

    own: Array
    seen: Array
    felt: float | None = None


class Hands(Body):
    """A body that knows how to handle things with the robot's hands.

    Attributes:
        lag: from an own movement until it is seen to begin, as experienced [s].
    """

    def __init__(self, traits: OperatorTraits, rng: np.random.Generator, sight: Sight) -> None:
        super().__init__(traits, rng, sight)
        self.lag = 0.1
        self._anchors = {s: self._anchored(s) for s in SIDES}
        self._onsets: dict[str, _Onset] = {}

    def look(self, sight: Sight, time: float, dt: float) -> None:
        """Take in one picture, and learn the lag from it."""
        super().look(sight, time, dt)
        for side in SIDES:
            self._feel_lag(side)

    def engage(self, *sides: str) -> Act:
        """Squeeze the clutches and look where the robot's hands are."""
        for side in sides:
            self.limbs[side].squeeze = 1.0
        yield from self.pause(2.0 * self.dt)
        for side in sides:
            self._anchors[side] = self._anchored(side)
        return True

    def expected(self, side: str) -> Pose:
        """Where the robot's hand should be by now, in the body frame."""
        anchor, limb = self._anchors[side], self.limbs[side]
        turn = rotation_between(anchor.quaternion, limb.quaternion)
        return Pose(
            anchor.seen.position + limb.position - anchor.position,
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
        until: Sign | None = None,
        through: bool = False,
    ) -> Act:
        """Bring a hand to a goal, look, and correct.

        Args:
            side: ``left`` or ``right``.
            goal: where to, looked at again before each correction.
            speed: share of the operator's usual speed.
            tolerance: near enough [m].
            angle: turned near enough [rad].
            corrections: at most so many.
            until: ends the reach at once, after a reaction time.
            through: do not stop and look; the next reach goes on from here.

        Returns:
            whether the hand was seen near enough, or ``until``.
        """
        for attempt in range(1 + corrections):
            target = goal(self.sight)
            self._aim(side, target, speed, _CORRECTION if attempt else np.inf)
            ended = yield from self._watch(side, until)
            if ended or through:
                return True
            yield from self.settle(side)
            if until is not None and until(self.sight):
                return True
            seen, target = self.sight.hands[side], goal(self.sight)
            off = float(np.linalg.norm(target.position - seen.position))
            turned = float(np.linalg.norm(rotation_between(seen.quaternion, target.quaternion)))
            if off < tolerance and turned < angle:
                return True
            if attempt < corrections:
                yield from self.react()
        return False

    def _aim(self, side: str, target: Pose, speed: float, longest: float) -> None:
        traits, limb, here = self.traits, self.limbs[side], self.expected(side)
        shift = target.position - here.position
        turn = rotation_between(here.quaternion, target.quaternion)
        distance, angle = float(np.linalg.norm(shift)), float(np.linalg.norm(turn))
        if distance > longest:
            shift, distance = shift * (longest / distance), longest
        shift = shift + self.rng.normal(0.0, traits.aim_error * distance, 3)
        needed = max(distance / traits.reach_speed, angle / traits.turn_speed)
        duration = max(traits.shortest_reach, needed) / speed
        limb.move(shift, turn, duration)
        self._onsets[side] = _Onset(limb.position, self.sight.hands[side].position)

    def _watch(self, side: str, until: Sign | None) -> Act:
        """Let a reach go on to its end, or until something is seen."""
        limb = self.limbs[side]
        while limb.moving:
            yield
            if until is not None and until(self.sight):
                yield from self.react()
                limb.stop()
                return True
        return False

    def _feel_lag(self, side: str) -> None:
        """Learn the lag from when a reach is felt and when it is seen to begin."""
        onset, limb = self._onsets.get(side), self.limbs[side]
        if onset is None:
            return
        if onset.felt is None and float(np.linalg.norm(limb.position - onset.own)) > _ONSET:
            onset.felt = self.time
        moved = float(np.linalg.norm(self.sight.hands[side].position - onset.seen))
        if onset.felt is not None and moved > _ONSET:
            self.lag += 0.5 * (self.time - onset.felt - self.lag)
            del self._onsets[side]

    def settle(self, side: str) -> Act:
        """Wait until the robot's hand is seen where it should be, or at rest elsewhere."""
        began, calm = self.time, 0.0
        while self.time - began < _LONGEST_WAIT:
            yield
            calm = calm + self.dt if self.hand_speed(side) < self.traits.still else 0.0
            seen, expected = self.sight.hands[side], self.expected(side)
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
        direction: Callable[[Sight], Array],
        distance: float,
        *,
        speed: float,
        until: Sign,
        lead: float = 0.07,
    ) -> Act:
        """Advance steadily until something is seen, never far ahead of what is seen.

        Args:
            side: ``left`` or ``right``.
            direction: unit vector (3,) in the body frame.
            distance: at most so far [m].
            speed: [m/s].
            until: what ends it, after a reaction time.
            lead: the own hand waits when it is this far ahead of the robot's [m].

        Returns:
            whether ``until`` was seen.
        """
        limb, gone, pace, blocked = self.limbs[side], 0.0, 0.0, 0.0
        line = self.sight.hands[side].position
        while gone < distance and not until(self.sight):
            heading = direction(self.sight)
            ahead = self.expected(side).position - self.sight.hands[side].position
            room = float(ahead @ heading) < lead
            pace = min(speed, pace + speed * self.dt / _RAMP) if room else 0.0
            astray = self.sight.hands[side].position - line
            aside = astray - float(astray @ heading) * heading
            limb.drive(pace * heading - _STEER * aside)
            yield
            gone += pace * self.dt
            blocked = 0.0 if room else blocked + self.dt
            if blocked > self.lag + 2.0 * self.traits.patience:
                break
        if until(self.sight):
            yield from self.react()
        limb.stop()
        seen = yield from self.wait_until(until, self.lag + self.traits.patience)
        return seen

    def grip(self, side: str, closure: float) -> Act:
        """Press or open the trigger, and wait until the gripper should have followed."""
        limb = self.limbs[side]
        limb.finger(closure, self.traits.grip_time)
        while limb.finger_busy:
            yield
        yield from self.pause(self.lag + 0.3)
        return True

    def _anchored(self, side: str) -> _Anchor:
        limb = self.limbs[side]
        return _Anchor(self.sight.hands[side], limb.position, limb.quaternion)
