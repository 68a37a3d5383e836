"""Measures how far and how roughly the hands were moved in a trial."""

import numpy as np

from common.robot.joints import JOINTS
from common.schemas import PlantState, Setpoint
from common.schemas.arrays import Float64Array as Array

_ARMS = np.array([i for i, joint in enumerate(JOINTS) if joint.group.endswith("arm")])


class HandMotion:
    """Accumulates the set-points and states of a trial, each in order of time."""

    def __init__(self) -> None:
        self._hands: Array | None = None
        self._path = 0.0
        self._last: PlantState | None = None
        self._squares, self._states = 0.0, 0

    @property
    def hand_path(self) -> float | None:
        """Length of the path of both hands' set-points in the body frame [m]; None without any."""
        return None if self._hands is None else self._path

    @property
    def arm_acceleration(self) -> float | None:
        """Root mean square of the arms' joint accelerations since the first set-point [rad/s²].

        The mean is over joints and time; accelerations are differences of measured velocities.
        """
        return float(np.sqrt(self._squares / self._states)) if self._states else None

    def add_setpoint(self, setpoint: Setpoint) -> None:
        """Add a set-point of the operator."""
        hands = np.array(
            [setpoint.left_hand_position_in_body, setpoint.right_hand_position_in_body]
        )
        if self._hands is not None:
            self._path += float(np.linalg.norm(hands - self._hands, axis=1).sum())
        self._hands = hands

    def add_state(self, state: PlantState) -> None:
        """Add a measured state of the robot."""
        last, self._last = self._last, state
        if last is None or self._hands is None or last.reset_count != state.reset_count:
            return
        elapsed = 1e-9 * (state.header.stamp - last.header.stamp)
        if elapsed <= 0.0:
            return
        change = (state.joint_velocity - last.joint_velocity)[_ARMS] / elapsed
        self._squares += float(np.mean(change**2))
        self._states += 1
