"""A person's hand with a controller in it: bell-shaped moves, tremor, fingers."""

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

TREMOR_BAND = (0.8, 9.0)
"""Frequencies of the tremor [Hz]; below the Nyquist frequency of 20 Hz samples."""
_TONES = 8


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
        """(axes,) at ``time`` [s]."""
        tones: Array = np.sin(self._rates * time + self._phases).sum(axis=1)
        return self._amplitude * tones


def minimum_jerk(share: float) -> float:
    """Way covered, 0 to 1, after a share of a reach's duration."""
    s = min(max(share, 0.0), 1.0)
    return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)


class Limb:
    """One controller, in the frame of the person: origin on the floor below, x where it faces.

    Attributes:
        side: ``left`` or ``right``.
        position: (3,) without tremor [m].
        quaternion: (4,) likewise.
        trigger: 0 to 1.
        squeeze: 0 to 1.
    """

    def __init__(self, side: str, rng: np.random.Generator, tremor: float, angle: float) -> None:
        sign = 1.0 if side == "left" else -1.0
        self.side = side
        self.position = np.array([0.36, 0.22 * sign, 1.12]) + rng.normal(0.0, 0.02, 3)
        self.quaternion = quaternion_from_rotation_vector(rng.normal(0.0, 0.1, 3))
        self.trigger = 0.0
        self.squeeze = 0.0
        self._goal_trigger = 0.0
        self._trigger_time = 0.25
        self._shake = Tremor(rng, tremor, 3)
        self._shiver = Tremor(rng, angle, 3)
        self._velocity = np.zeros(3)
        self._move: tuple[Array, Array, Array, Array] | None = None
        self._elapsed = self._duration = 0.0

    @property
    def moving(self) -> bool:
        """Whether a reach is under way."""
        return self._move is not None

    def move(self, shift: Array, turn: Array, duration: float) -> None:
        """Begin a reach: by ``shift`` (3,) [m] and about ``turn`` (3,) [rad], at rest after."""
        self._move = (self.position, shift, self.quaternion, turn)
        self._elapsed, self._duration = 0.0, duration

    def drive(self, velocity: Array) -> None:
        """Move steadily (3,) [m/s] until told otherwise; ends a reach."""
        self._move, self._velocity = None, velocity

    def stop(self) -> None:
        """Rest where it is."""
        self._move, self._velocity = None, np.zeros(3)

    def finger(self, goal: float, duration: float) -> None:
        """Press the trigger to ``goal`` within about ``duration`` [s]."""
        self._goal_trigger, self._trigger_time = goal, duration

    @property
    def finger_busy(self) -> bool:
        """Whether the trigger has not arrived."""
        return self.trigger != self._goal_trigger

    def advance(self, dt: float) -> None:
        """Live on for ``dt`` [s]."""
        if self._move is not None:
            start, shift, before, turn = self._move
            self._elapsed += dt
            way = minimum_jerk(self._elapsed / self._duration)
            self.position = start + way * shift
            self.quaternion = rotate(before, way * turn)
            if self._elapsed >= self._duration:
                self._move = None
        else:
            self.position = self.position + self._velocity * dt
        step = dt / self._trigger_time
        self.trigger += min(max(self._goal_trigger - self.trigger, -step), step)

    def controller(self, time: float, facing: float) -> HandController:
        """What the device reports; ``facing``: the person's heading in the room [rad]."""
        position = self.position + self._shake.at(time)
        turned = multiply(quaternion_from_rotation_vector(self._shiver.at(time)), self.quaternion)
        about = rotation_between(np.array([1.0, 0.0, 0.0, 0.0]), turned)
        # The device's axes are the room's: a turn about the person's axes, seen from there.
        return HandController(
            position=rotate_about_z(position, facing),
            quaternion=quaternion_from_rotation_vector(rotate_about_z(about, facing)),
            tracked=True,
            trigger=min(max(self.trigger, 0.0), 1.0),
            squeeze=self.squeeze,
        )
