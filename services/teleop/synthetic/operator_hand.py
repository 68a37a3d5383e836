"""The operator's own hand with a controller in it: minimum-jerk reaches, tremor, trigger."""

import math

import numpy as np

from common.robot.rotations import (
    multiply,
    quaternion_from_rotation_vector,
    rotate,
    rotate_about_z,
    rotation_between,
)
from common.schemas import HandController
from common.schemas.arrays import Float64Array as Array
from services.teleop.targets.hand import minimum_jerk

TREMOR_BAND = (0.8, 9.0)
"""Frequencies of the tremor [Hz], below the Nyquist frequency of samples at 20 Hz."""
_TONES = 8
_KNOCK, _RETURN = 0.25, 0.6
"""Times that a hand takes to be knocked off its way, and to come back [s]."""
_NOT_ROTATED = np.array([1.0, 0.0, 0.0, 0.0])


class Tremor:
    """Band-limited noise with a given standard deviation per axis: tones of random phase."""

    def __init__(self, rng: np.random.Generator, deviation: float, axes: int) -> None:
        low, high = TREMOR_BAND
        self._rates = (
            2.0 * math.pi * np.exp(rng.uniform(math.log(low), math.log(high), (axes, _TONES)))
        )
        self._phases = rng.uniform(0.0, 2.0 * math.pi, (axes, _TONES))
        self._amplitude = deviation * math.sqrt(2.0 / _TONES)

    def at(self, time: float) -> Array:
        """Return the noise (axes,) at ``time`` [s]."""
        tones: Array = np.sin(self._rates * time + self._phases).sum(axis=1)
        return self._amplitude * tones


class Slips:
    """Knocks that displace a hand at random times; each time it comes back.

    Attributes:
        offset: (6,) displacement [m] and rotation vector [rad] of the hand.
    """

    def __init__(
        self, rng: np.random.Generator, rate: float, distance: float, angle: float
    ) -> None:
        """Begin without one; nothing is drawn if there are to be none.

        Args:
            rng: of times and displacements.
            rate: how often [1/s].
            distance: standard deviation per axis [m].
            angle: standard deviation per axis [rad].
        """
        self.offset = np.zeros(6)
        self._rng, self._rate = rng, rate
        self._deviation = np.repeat((distance, angle), 3)
        self._farthest = np.zeros(6)
        self._elapsed = math.inf

    @property
    def away(self) -> bool:
        """Whether the hand is on its way off, not yet on its way back."""
        return self._elapsed <= _KNOCK

    def advance(self, dt: float, *, safe: bool) -> None:
        """Advance by ``dt`` [s]; a knock begins only while it is ``safe``."""
        self._elapsed += dt
        rests = safe and self._rate > 0.0 and self._elapsed >= _KNOCK + _RETURN
        if rests and self._rng.uniform() < self._rate * dt:
            self._farthest, self._elapsed = self._rng.normal(0.0, self._deviation), 0.0
        back = (self._elapsed - _KNOCK) / _RETURN
        share = minimum_jerk(self._elapsed / _KNOCK) if self.away else 1.0 - minimum_jerk(back)
        self.offset = share * self._farthest


class OperatorHand:
    """One hand controller, in the operator's frame: origin on the floor below, x ahead.

    Attributes:
        side: ``left`` or ``right``.
        position: (3,) without tremor [m].
        quaternion: (4,) without tremor.
        trigger: 0 to 1.
        squeeze: 0 to 1.
        slips: what knocks the hand off its way.
    """

    def __init__(
        self, side: str, rng: np.random.Generator, tremor: float, angle: float, slips: Slips
    ) -> None:
        """Draw the hand's rest pose.

        Args:
            side: ``left`` or ``right``.
            rng: of pose and tremor.
            tremor: standard deviation per axis [m].
            angle: standard deviation per axis [rad].
            slips: what knocks the hand off its way.
        """
        self.slips = slips
        sign = 1.0 if side == "left" else -1.0
        self.side = side
        self.position = np.array([0.36, 0.22 * sign, 1.12]) + rng.normal(0.0, 0.02, 3)
        self.quaternion = quaternion_from_rotation_vector(rng.normal(0.0, 0.1, 3))
        self.trigger = 0.0
        self.squeeze = 0.0
        self._goal_trigger = 0.0
        self._trigger_time = 0.25
        self._tremor = Tremor(rng, tremor, 3)
        self._angular_tremor = Tremor(rng, angle, 3)
        self._velocity = np.zeros(3)
        self._reach: tuple[Array, Array, Array, Array] | None = None
        self._elapsed = self._duration = 0.0

    @property
    def moving(self) -> bool:
        """Whether a reach is in progress."""
        return self._reach is not None

    def move(self, shift: Array, turn: Array, duration: float) -> None:
        """Start a reach from rest to rest.

        Args:
            shift: (3,) displacement [m].
            turn: (3,) rotation vector [rad].
            duration: [s].
        """
        self._reach = (self.position, shift, self.quaternion, turn)
        self._elapsed, self._duration = 0.0, duration

    def drive(self, velocity: Array) -> None:
        """Move with a constant velocity (3,) until further notice; ends a reach [m/s]."""
        self._reach, self._velocity = None, velocity

    def stop(self) -> None:
        """Stop where the hand is."""
        self._reach, self._velocity = None, np.zeros(3)

    def press_trigger(self, goal: float, duration: float) -> None:
        """Move the trigger to ``goal`` at the speed of a full stroke in ``duration`` [s]."""
        self._goal_trigger, self._trigger_time = goal, duration

    @property
    def trigger_moving(self) -> bool:
        """Whether the trigger is not at its goal."""
        return self.trigger != self._goal_trigger

    def advance(self, dt: float) -> None:
        """Advance reach, velocity and trigger by ``dt`` [s]."""
        if self._reach is not None:
            start, shift, before, turn = self._reach
            self._elapsed += dt
            share = minimum_jerk(self._elapsed / self._duration)
            self.position = start + share * shift
            self.quaternion = rotate(before, share * turn)
            if self._elapsed >= self._duration:
                self._reach = None
        else:
            self.position = self.position + self._velocity * dt
        # A person who is knocked does not go on to grip.
        self.slips.advance(dt, safe=not self.trigger_moving)
        step = dt / self._trigger_time
        self.trigger += min(max(self._goal_trigger - self.trigger, -step), step)

    def controller(self, time: float, facing: float) -> HandController:
        """Return the sample of the device.

        Args:
            time: since the start, for the tremor [s].
            facing: heading of the operator in the room [rad].
        """
        shift, turn = self.slips.offset[:3], self.slips.offset[3:]
        position = self.position + self._tremor.at(time) + shift
        turned = multiply(
            quaternion_from_rotation_vector(self._angular_tremor.at(time) + turn), self.quaternion
        )
        about = rotation_between(_NOT_ROTATED, turned)
        # The device's axes are the room's: a rotation about the operator's axes, seen from there.
        return HandController(
            position=rotate_about_z(position, facing),
            quaternion=quaternion_from_rotation_vector(rotate_about_z(about, facing)),
            tracked=True,
            trigger=min(max(self.trigger, 0.0), 1.0),
            squeeze=self.squeeze,
        )
