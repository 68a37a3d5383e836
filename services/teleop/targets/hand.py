"""Hand poses as operators name them, and a target that moves smoothly to a goal.

All poses are in the body frame (``torso_link``). A hand whose orientation is the identity of this
module's (roll, pitch, yaw) convention points straight ahead: its -z axis along body +x, fingers
opening sideways. A positive pitch points it down, a positive yaw to the left.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from common.robot.frames import NOMINAL_HAND_IN_BODY
from common.robot.kinematics import FORWARD_HAND
from common.robot.pose import Pose
from common.robot.rotations import (
    clamp_norm,
    conjugate,
    multiply,
    quaternion_from_rpy,
    rotate,
    rotation_between,
    rpy_from_quaternion,
)
from common.robot.workspace import clamp_to_workspace
from common.schemas.arrays import Float64Array as Array

SIDES: Final = ("left", "right")

NOMINAL_ROLL: Final = 0.5236
"""Roll of the left hand at the nominal joint positions, from the shoulder's abduction [rad]."""
HOME_POSITION: Final = (0.30, 0.26, 0.04)
"""Home position of the left hand, which points straight ahead [m]; the right hand's is mirrored.

The public TRILL configuration uses (0.22, 0.25, 0.1) in ``base_com``. By inverse kinematics with
the joint limits of the DRACO 3 URDF a level hand does not reach it, so home is the nearest pose in
which all joints but the shoulder's are at least 0.4 rad from their limits.
"""


class MotionLimits(BaseModel):
    """Speeds and accelerations of targets whose goals move in steps, for instance with keys."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    linear_speed: float = Field(default=0.35, gt=0.0, description="[m/s]")
    angular_speed: float = Field(default=2.0, gt=0.0, description="[rad/s]")
    linear_acceleration: float = Field(default=2.0, gt=0.0, description="[m/s²]")
    angular_acceleration: float = Field(default=12.0, gt=0.0, description="[rad/s²]")
    settling: float = Field(default=0.2, gt=0.0, description="time constant of the approach [s]")
    closure_speed: float = Field(default=2.0, gt=0.0, description="of a gripper [strokes/s]")
    neck_speed: float = Field(default=1.0, gt=0.0, description="[rad/s]")
    lead_distance: float = Field(
        default=0.08, gt=0.0, description="largest lead of a goal moved in steps [m]"
    )
    lead_angle: float = Field(default=0.4, gt=0.0, description="likewise, rotation [rad]")


def hand_quaternion(roll: float, pitch: float, yaw: float) -> Array:
    """Return the quaternion (4,) of a hand rotated about body axes from pointing ahead [rad]."""
    return multiply(quaternion_from_rpy(roll, pitch, yaw), FORWARD_HAND)


def hand_rpy(quaternion: Array) -> tuple[float, float, float]:
    """Return roll, pitch and yaw of a hand relative to pointing ahead [rad]."""
    return rpy_from_quaternion(multiply(quaternion, conjugate(FORWARD_HAND)))


def nominal_pose(side: str) -> Pose:
    """Return the pose of hand ``side`` at the robot's nominal joint positions."""
    roll = NOMINAL_ROLL if side == "left" else -NOMINAL_ROLL
    return Pose(np.array(NOMINAL_HAND_IN_BODY[side]), hand_quaternion(roll, 0.0, 0.0))


def home_pose(side: str) -> Pose:
    """Return the pose to which hand ``side`` is sent home."""
    sign = 1.0 if side == "left" else -1.0
    return Pose(np.array(HOME_POSITION) * (1.0, sign, 1.0), FORWARD_HAND.copy())


def minimum_jerk(share: float) -> float:
    """Return the share of the way that a minimum-jerk motion has covered after a share of its time.

    Source: T. Flash and N. Hogan, "The coordination of arm movements", J. Neuroscience 5 (1985).
    """
    s = min(max(share, 0.0), 1.0)
    return s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)


def _pursue(error: Array, velocity: Array, speed: float, change: float, settling: float) -> Array:
    """Return the next velocity towards a goal ``error`` away, within limits of speed and change."""
    return clamp_norm(
        velocity + clamp_norm(clamp_norm(error / settling, speed) - velocity, change), speed
    )


@dataclass
class HandTarget:
    """Target pose of one hand and the goal it moves to, in the body frame.

    The controller keeps what is published within the workspace. Here only goals that grow step by
    step are kept there too, so that a key held down does not pile up steps to take back.

    Attributes:
        side: ``left`` or ``right``.
        limits: speeds and accelerations.
        position, quaternion: the target as published; starts at the nominal hand pose.
        goal_position, goal_quaternion: pose to which the target moves.
    """

    side: str
    limits: MotionLimits
    position: Array = field(init=False)
    quaternion: Array = field(init=False)
    goal_position: Array = field(init=False)
    goal_quaternion: Array = field(init=False)
    _velocity: Array = field(init=False)
    _rate: Array = field(init=False)

    def __post_init__(self) -> None:
        self.place(nominal_pose(self.side))

    def place(self, pose: Pose) -> None:
        """Set target and goal at once, at rest."""
        self.position, self.quaternion = pose.position, pose.quaternion
        self.goal_position, self.goal_quaternion = pose.position, pose.quaternion
        self._velocity, self._rate = np.zeros(3), np.zeros(3)

    def go_to(self, pose: Pose) -> None:
        """Set the goal."""
        self.goal_position, self.goal_quaternion = pose.position, pose.quaternion

    def shift(self, step: Array) -> None:
        """Move the goal by ``step`` (3,), at most ``lead_distance`` ahead of the target [m].

        The limit prevents a long motion that goes on after the release of a key.
        """
        lead = self.goal_position + step - self.position
        ahead = max(
            self.limits.lead_distance, float(np.linalg.norm(self.goal_position - self.position))
        )
        self.goal_position = clamp_to_workspace(self.side, self.position + clamp_norm(lead, ahead))

    def turn(self, rotation: Array) -> None:
        """Rotate the goal by ``rotation`` (3,) about body axes, at most ``lead_angle`` ahead."""
        ahead = max(
            self.limits.lead_angle,
            float(np.linalg.norm(rotation_between(self.quaternion, self.goal_quaternion))),
        )
        lead = rotation_between(self.quaternion, rotate(self.goal_quaternion, rotation))
        self.goal_quaternion = rotate(self.quaternion, clamp_norm(lead, ahead))

    def approach(self, dt: float) -> None:
        """Move the target towards the goal for ``dt`` [s] with limited speed and acceleration."""
        limits = self.limits
        self._velocity = _pursue(
            self.goal_position - self.position,
            self._velocity,
            limits.linear_speed,
            limits.linear_acceleration * dt,
            limits.settling,
        )
        self._rate = _pursue(
            rotation_between(self.quaternion, self.goal_quaternion),
            self._rate,
            limits.angular_speed,
            limits.angular_acceleration * dt,
            limits.settling,
        )
        self.position = self.position + self._velocity * dt
        self.quaternion = rotate(self.quaternion, self._rate * dt)

    @property
    def distance(self) -> float:
        """Distance from the target to its goal [m]."""
        return float(np.linalg.norm(self.goal_position - self.position))

    @property
    def angle(self) -> float:
        """Angle from the target to its goal [rad]."""
        return float(np.linalg.norm(rotation_between(self.quaternion, self.goal_quaternion)))
