"""Targets of hands, grippers and neck that move towards their goals, as set-point messages."""

from dataclasses import dataclass, field

import numpy as np

from common.robot.joints import JOINTS, NECK
from common.robot.pose import Pose
from common.robot.workspace import clamp_to_workspace
from common.schemas import Header, Setpoint
from common.schemas.arrays import Float64Array as Array
from services.teleop.targets.hand import SIDES, HandTarget, MotionLimits

_NECK = JOINTS[NECK.start]


def _towards(value: Array, goal: Array, largest: float) -> Array:
    return value + np.clip(goal - value, -largest, largest)


@dataclass
class OperatorTargets:
    """Targets of a set-point: two hands, two grippers and the neck.

    Attributes:
        limits: speeds and accelerations.
        hands: target of each hand, by side.
        closure, goal_closure: (2,) left and right gripper, 0 open to 1 closed.
        neck, goal_neck: head pitch, positive looks down [rad].
    """

    limits: MotionLimits = field(default_factory=MotionLimits)
    hands: dict[str, HandTarget] = field(init=False)
    closure: Array = field(init=False, default_factory=lambda: np.zeros(2))
    goal_closure: Array = field(init=False, default_factory=lambda: np.zeros(2))
    neck: float = 0.0
    goal_neck: float = 0.0

    def __post_init__(self) -> None:
        self.hands = {side: HandTarget(side, self.limits) for side in SIDES}

    def grip(self, side: str, closure: float) -> None:
        """Set the goal of the gripper ``side``, 0 open to 1 closed."""
        goal = self.goal_closure.copy()
        goal[SIDES.index(side)] = np.clip(closure, 0.0, 1.0)
        self.goal_closure = goal

    def look(self, pitch: float) -> None:
        """Set the goal of the neck [rad], clamped to its joint's range."""
        self.goal_neck = float(np.clip(pitch, _NECK.lower, _NECK.upper))

    def adopt(self, setpoint: Setpoint) -> None:
        """Continue from another operator's set-point."""
        poses = {
            "left": (setpoint.left_hand_position_in_body, setpoint.left_hand_quaternion_in_body),
            "right": (setpoint.right_hand_position_in_body, setpoint.right_hand_quaternion_in_body),
        }
        for side, (position, quaternion) in poses.items():
            self.hands[side].place(Pose(clamp_to_workspace(side, position), quaternion))
        self.closure = self.goal_closure = np.clip(setpoint.gripper_closure, 0.0, 1.0)
        self.look(setpoint.neck_pitch)
        self.neck = self.goal_neck

    def advance(self, dt: float) -> None:
        """Move all targets towards their goals for ``dt`` [s]."""
        for hand in self.hands.values():
            hand.approach(dt)
        limits = self.limits
        self.closure = _towards(self.closure, self.goal_closure, limits.closure_speed * dt)
        step = limits.neck_speed * dt
        self.neck += float(np.clip(self.goal_neck - self.neck, -step, step))

    def setpoint(self, stamp: int) -> Setpoint:
        """Return the set-point message; ``stamp`` is the robot time the operator acted on [ns]."""
        left, right = self.hands["left"], self.hands["right"]
        return Setpoint(
            header=Header(stamp=stamp),
            left_hand_position_in_body=left.position,
            left_hand_quaternion_in_body=left.quaternion,
            right_hand_position_in_body=right.position,
            right_hand_quaternion_in_body=right.quaternion,
            gripper_closure=self.closure,
            neck_pitch=self.neck,
        )
