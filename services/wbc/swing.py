"""Trajectory of a swing foot: minimum jerk across, two minimum-jerk halves up and down."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from common.robot.rotations import matrix_from_rotation_vector, rotation_vector_from_matrix
from common.schemas.arrays import Float64Array as Array
from services.wbc.references import PoseReference


def minimum_jerk(share: float, duration: float) -> tuple[float, float, float]:
    """Return position, velocity [1/s] and acceleration [1/s²] of a minimum-jerk motion 0 to 1.

    Args:
        share: elapsed share of the duration; clipped to 0..1.
        duration: [s].
    """
    s = min(max(share, 0.0), 1.0)
    position = s**3 * (10.0 + s * (6.0 * s - 15.0))
    velocity = 30.0 * s * s * (1.0 - s) ** 2 / duration
    acceleration = 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / duration**2
    return position, velocity, acceleration


@dataclass(frozen=True)
class SwingTrajectory:
    """Trajectory of a sole from lift-off to landing.

    Attributes:
        start, end: (3,) sole positions in world [m].
        start_rotation, end_rotation: (3, 3).
        height: clearance above the higher of start and end [m]; 0 goes straight across.
        duration: [s].
    """

    start: Array
    start_rotation: Array
    end: Array
    end_rotation: Array
    height: float
    duration: float

    def at(self, time: float) -> PoseReference:
        """Return the reference ``time`` [s] after lift-off; at rest outside [0, duration]."""
        s, sd, sdd = minimum_jerk(time / self.duration, self.duration)
        pose, velocity, acceleration = s * self._change, sd * self._change, sdd * self._change
        position = self.start + pose[:3]
        position[2], velocity[2], acceleration[2] = self._height_at(time)
        rotation = matrix_from_rotation_vector(pose[3:]).dot(self.start_rotation)
        return PoseReference(position, rotation, velocity, acceleration)

    @cached_property
    def _change(self) -> Array:
        """(6,) displacement and rotation vector; its axis is fixed, so its rate is the twist."""
        turn = rotation_vector_from_matrix(self.end_rotation @ self.start_rotation.T)
        return np.concatenate((self.end - self.start, turn))

    def _height_at(self, time: float) -> tuple[float, float, float]:
        if self.height == 0.0:
            s, sd, sdd = minimum_jerk(time / self.duration, self.duration)
            rise = float(self.end[2] - self.start[2])
            return float(self.start[2]) + s * rise, sd * rise, sdd * rise
        half = 0.5 * self.duration
        start, end = float(self.start[2]), float(self.end[2])
        apex = max(start, end) + self.height
        rising = time < half
        a, b = (start, apex) if rising else (apex, end)
        s, sd, sdd = minimum_jerk((time if rising else time - half) / half, half)
        return a + s * (b - a), sd * (b - a), sdd * (b - a)
