"""The set-points that are still to be sent: what is left of an answer; pure."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from common.robot.kinematics import FORWARD_HAND
from common.schemas import Header, Setpoint
from common.schemas.arrays import Float64Array as Array
from services.policy.processor.actions import Command

CLOSED = 0.5
"""Probability above which a gripper closes."""


class Target(NamedTuple):
    """A whole set-point.

    Attributes:
        command: of hands and neck.
        closure: (2,) of left and right gripper; 0 open, 1 closed.
    """

    command: Command
    closure: Array

    def setpoint(self, stamp: int) -> Setpoint:
        """Return the message; ``stamp`` is the robot time of the state that was acted on [ns]."""
        hands = self.command.hands
        return Setpoint(
            header=Header(stamp=stamp),
            left_hand_position_in_body=hands[:3],
            left_hand_quaternion_in_body=hands[3:7],
            right_hand_position_in_body=hands[7:10],
            right_hand_quaternion_in_body=hands[10:],
            gripper_closure=self.closure,
            neck_pitch=self.command.neck,
        )


RESTING = Target(
    Command(np.concatenate((np.zeros(3), FORWARD_HAND, np.zeros(3), FORWARD_HAND)), 0.0),
    np.zeros(2),
)
"""Stands in until the controller's target is known; it is never sent."""


class Plan:
    """What is left of the last answer.

    Attributes:
        executed: steps of it that were carried out.
    """

    def __init__(self) -> None:
        self.executed = 0
        self._targets: list[Target] = []

    def __len__(self) -> int:
        """Return how many steps are left."""
        return len(self._targets)

    def replace(self, targets: Sequence[Target], skipped: int) -> bool:
        """Take a new answer less the ``skipped`` first steps; False: none of it would be left.

        Skipped are the steps that passed since the request: they were carried out by the plan
        before. With a delay on the way to the robot, those that would be past on arrival, too.
        """
        left = list(targets[skipped:])
        if left:
            self._targets, self.executed = left, 0
        return bool(left)

    def take(self) -> Target:
        """Remove and return the next set-point."""
        self.executed += 1
        return self._targets.pop(0)
