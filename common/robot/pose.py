"""Poses of frames: in space (:class:`Pose`) and on the floor (:class:`Pose2`)."""

from dataclasses import dataclass
from math import cos, sin
from typing import Self

import numpy as np

from common.robot.rotations import (
    conjugate,
    multiply,
    rotate_vector,
    wrap_angle,
    yaw_from_quaternion,
)
from common.schemas.arrays import Float64Array as Array


# The arrays have no truth value, so the generated comparison would raise.
@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Pose of a frame in an outer frame, for instance the world.

    Attributes:
        position: (3,) origin in the outer frame [m].
        quaternion: (4,) rotation to the outer frame (w, x, y, z), of norm one.
    """

    position: Array
    quaternion: Array

    @classmethod
    def upright(cls, x: float, y: float, z: float = 0.0, yaw: float = 0.0) -> Self:
        """Return a pose whose z axis points up [m, rad]."""
        return cls(np.array([x, y, z]), np.array([cos(0.5 * yaw), 0.0, 0.0, sin(0.5 * yaw)]))

    @property
    def yaw(self) -> float:
        """Heading: direction of the x axis in the horizontal plane [rad]."""
        return yaw_from_quaternion(self.quaternion)

    def apply(self, point: Array) -> Array:
        """Return a point (3,) of this frame in the outer frame [m]."""
        return self.position + rotate_vector(self.quaternion, point)

    def local(self, point: Array) -> Array:
        """Return a point (3,) of the outer frame in this frame [m]."""
        return rotate_vector(conjugate(self.quaternion), point - self.position)

    def local_pose(self, pose: "Pose") -> "Pose":
        """Return a pose of the outer frame in this frame."""
        rotation = multiply(conjugate(self.quaternion), pose.quaternion)
        return Pose(self.local(pose.position), rotation)


@dataclass(frozen=True, slots=True)
class Pose2:
    """Pose on the floor, or a motion between two of them.

    Attributes:
        x: [m].
        y: [m].
        yaw: heading [rad].
    """

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def then(self, motion: "Pose2") -> "Pose2":
        """Return the pose reached by ``motion``, which is given in this pose's frame."""
        c, s = cos(self.yaw), sin(self.yaw)
        return Pose2(
            self.x + c * motion.x - s * motion.y,
            self.y + s * motion.x + c * motion.y,
            wrap_angle(self.yaw + motion.yaw),
        )

    def to(self, other: "Pose2") -> "Pose2":
        """Return the motion to ``other`` in this pose's frame: forward, left, turn."""
        c, s = cos(self.yaw), sin(self.yaw)
        dx, dy = other.x - self.x, other.y - self.y
        return Pose2(c * dx + s * dy, -s * dx + c * dy, wrap_angle(other.yaw - self.yaw))
