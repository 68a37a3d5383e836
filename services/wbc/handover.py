"""Targets of an operator, and how they go over to those of another without a jump."""

from typing import NamedTuple, Self

import numpy as np

from common.robot.rotations import (
    matrix_from_quaternion,
    matrix_from_rotation_vector,
    quaternion_from_rotation_vector,
    rotation_vector_from_matrix,
)
from common.schemas import Header, Setpoint
from common.schemas.arrays import Float64Array as Array
from services.wbc.config import AuthorityConfig
from services.wbc.swing import minimum_jerk


class Target(NamedTuple):
    """Where the operator wants hands, grippers and neck.

    Attributes:
        positions: (2, 3) left and right hand in the body frame [m].
        rotations: (2, 3, 3) hand to body.
        grippers: (2,) left and right; 0 open, 1 closed.
        neck: head pitch, positive looks down [rad].
    """

    positions: Array
    rotations: Array
    grippers: Array
    neck: float

    @classmethod
    def of(cls, setpoint: Setpoint) -> Self:
        """Return the targets of a set-point."""
        left, right = setpoint.left_hand_quaternion_in_body, setpoint.right_hand_quaternion_in_body
        return cls(
            np.array([setpoint.left_hand_position_in_body, setpoint.right_hand_position_in_body]),
            np.array([matrix_from_quaternion(left), matrix_from_quaternion(right)]),
            setpoint.gripper_closure,
            setpoint.neck_pitch,
        )

    def setpoint(self, stamp: int) -> Setpoint:
        """Return the set-point of these targets at a robot time [ns]."""
        left, right = (
            quaternion_from_rotation_vector(rotation_vector_from_matrix(rotation))
            for rotation in self.rotations
        )
        return Setpoint(
            header=Header(stamp=stamp),
            left_hand_position_in_body=self.positions[0],
            left_hand_quaternion_in_body=left,
            right_hand_position_in_body=self.positions[1],
            right_hand_quaternion_in_body=right,
            gripper_closure=self.grippers,
            neck_pitch=self.neck,
        )


class HandOver:
    """Adds the difference between old and new targets to the new ones, and lets it fade.

    An operator that starts at the present targets is thus followed at once, and any other without a
    jump. The robot's first operator is a new one too.
    """

    def __init__(self, config: AuthorityConfig) -> None:
        self._config = config
        self._due = True
        self._start, self._duration = 0.0, 0.0
        self._shift, self._turns = np.zeros((2, 3)), [np.zeros(3), np.zeros(3)]
        self._grippers, self._neck = np.zeros(2), 0.0

    def begin(self) -> None:
        """Note that the next targets are a new operator's."""
        self._due = True

    def apply(self, target: Target, present: Target, time: float) -> Target:
        """Return the targets to follow instead of the operator's.

        Args:
            target: the operator's.
            present: those followed so far.
            time: robot time [s].
        """
        if self._due:
            self._start_fading(target, present, time)
        share = (time - self._start) / self._duration if self._duration else 1.0
        if share >= 1.0:
            return target
        left = 1.0 - minimum_jerk(share, 1.0)[0]
        rotations = [
            matrix_from_rotation_vector(left * turn) @ rotation
            for turn, rotation in zip(self._turns, target.rotations, strict=True)
        ]
        return Target(
            target.positions + left * self._shift,
            np.array(rotations),
            target.grippers + left * self._grippers,
            target.neck + left * self._neck,
        )

    def _start_fading(self, target: Target, present: Target, time: float) -> None:
        config = self._config
        self._due, self._start = False, time
        self._shift = present.positions - target.positions
        self._turns = [
            rotation_vector_from_matrix(old @ new.T)
            for old, new in zip(present.rotations, target.rotations, strict=True)
        ]
        self._grippers = present.grippers - target.grippers
        self._neck = present.neck - target.neck
        distance = float(np.linalg.norm(self._shift, axis=1).max())
        angle = max(float(np.linalg.norm(turn)) for turn in self._turns)
        self._duration = max(
            config.blend_time, distance / config.blend_speed, angle / config.blend_turn_rate
        )
