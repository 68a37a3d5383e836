"""Measures how long a trial stood still: an operator that is stuck does not move the robot."""

import numpy as np

from common.episodes.columns import RATE
from common.episodes.observation import action
from common.schemas import Gait, Setpoint
from common.schemas.arrays import Float64Array as Array
from common.topics import TELEOP_SETPOINT, WBC_STATE
from lab.trials.stack import TaskStack
from services.policy.processor.actions import moving


class Stillness:
    """Notes the set-points of a trial until its verdict.

    A set-point stands still if neither hand is moved faster than 3 cm/s or 0.15 rad/s, and neither
    gripper, in the 0.3 s before it, while no gait is in progress.
    """

    def __init__(self, stack: TaskStack) -> None:
        """Subscribe to the messages of a trial that has not begun."""
        self._hands: list[Array] = []
        self._grasp: list[Array] = []
        self._standing: list[bool] = []
        self._stack = stack
        self._controller = stack.runner.newest(WBC_STATE)
        stack.runner.on_message(TELEOP_SETPOINT, self._on_setpoint)

    def _on_setpoint(self, setpoint: Setpoint) -> None:
        controller = self._controller()
        if self._stack.over or controller is None:
            return
        columns = action(setpoint)
        self._hands.append(np.asarray(columns["action/hands"]))
        self._grasp.append(np.asarray(columns["action/grasp"]))
        self._standing.append(controller.gait is Gait.NONE)

    @property
    def seconds(self) -> float:
        """Time that the trial stood still so far [s]."""
        if not self._hands:
            return 0.0
        still = np.array(self._standing) & ~moving(np.array(self._hands), np.array(self._grasp))
        return float(still.sum()) / RATE
