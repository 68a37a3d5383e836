"""One hand's target: where an operator wants it, moved there within limits.

All poses are in the body frame (``torso_link``). A hand whose orientation is the identity of this
module's (roll, pitch, yaw) convention points straight ahead: its -z axis along body +x, fingers
opening sideways. A positive pitch points it down, a positive yaw to the left.
"""

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from common.robot.frames import BASE_COM_HEIGHT, FORWARD_HAND_IN_BODY, NOMINAL_HAND_IN_BODY
from common.robot.joints import JOINTS, NECK
from common.robot.rotations import Array, from_rpy, multiply, rotate, rotation_vector, to_rpy

SIDES: Final = ("left", "right")
FORWARD_HAND: Final = np.array(FORWARD_HAND_IN_BODY)

NOMINAL_ROLL: Final = 0.5236
"""Roll of the left hand at the nominal joint positions (its shoulder's abduction) [rad]."""
HOME_POSITION: Final = (0.30, 0.26, 0.04)
"""Home of the left hand, pointing straight ahead [m]; the right hand's is its mirror image.

The public TRILL configuration asks for (0.22, 0.25, 0.1) in ``base_com``. By inverse kinematics
on the joint limits of the DRACO 3 URDF that pose is out of reach with the hand level, so home is
the nearest comfortable pose: within 0.4 rad of no joint limit but the shoulder's.
"""


class TargetLimits(BaseModel):
    """How fast and how far the targets may move; the box is the left hand's, the right mirrors it.

    The box is that of the public TRILL configuration (there in ``base_com``), but with x from
    0.15 m so that a hand can be drawn back to the torso, to 0.56 m (there 0.50) so that a hand near
    the end of its reach can still be sent ahead of a thing to push it, and no higher than 0.40 m:
    above, close to the chest, the upper arms press against it and topple the robot.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    linear_speed: float = Field(default=0.35, gt=0.0, description="[m/s]")
    angular_speed: float = Field(default=2.0, gt=0.0, description="[rad/s]")
    linear_acceleration: float = Field(default=2.0, gt=0.0, description="[m/s²]")
    angular_acceleration: float = Field(default=12.0, gt=0.0, description="[rad/s²]")
    settling: float = Field(default=0.2, gt=0.0, description="time constant of the approach [s]")
    closure_speed: float = Field(default=2.0, gt=0.0, description="gripper strokes a second")
    neck_speed: float = Field(default=1.0, gt=0.0, description="[rad/s]")
    lead_distance: float = Field(default=0.08, gt=0.0, description="of a stepped goal [m]")
    lead_angle: float = Field(default=0.4, gt=0.0, description="of a stepped goal [rad]")
    box_low: tuple[float, float, float] = Field(
        default=(0.15, -0.10, -0.2 + BASE_COM_HEIGHT),
        description="of the left hand in the body frame [m]",
    )
    box_high: tuple[float, float, float] = Field(
        default=(0.56, 0.45, 0.40), description="likewise, the opposite corner [m]"
    )
    neck_low: float = Field(default=JOINTS[NECK.start].lower, description="highest look [rad]")
    neck_high: float = Field(default=JOINTS[NECK.start].upper, description="lowest look [rad]")

    def clamp(self, side: str, position: Array) -> Array:
        """``position`` (3,) [m] moved into the workspace box of hand ``side``."""
        mirror: Array = np.array([1.0, 1.0 if side == "left" else -1.0, 1.0])
        inside: Array = np.clip(position * mirror, self.box_low, self.box_high)
        return inside * mirror


def hand_quaternion(roll: float, pitch: float, yaw: float) -> Array:
    """Orientation (4,) of a forward-pointing hand turned about the body axes [rad]."""
    return multiply(from_rpy(roll, pitch, yaw), FORWARD_HAND)


def hand_rpy(quaternion: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw [rad] by which a hand is turned from pointing straight ahead."""
    return to_rpy(multiply(quaternion, FORWARD_HAND * np.array([1.0, -1.0, -1.0, -1.0])))


def home_pose(side: str) -> tuple[Array, Array]:
    """Position (3,) [m] and quaternion (4,) to which hand ``side`` is sent home."""
    sign = 1.0 if side == "left" else -1.0
    return np.array(HOME_POSITION) * (1.0, sign, 1.0), FORWARD_HAND.copy()


def _pursue(error: Array, velocity: Array, speed: float, change: float, settling: float) -> Array:
    """Next velocity towards a goal ``error`` away, within ``speed`` and ``change`` of velocity."""
    return _shortened(
        velocity + _shortened(_shortened(error / settling, speed) - velocity, change), speed
    )


def _shortened(vector: Array, longest: float) -> Array:
    norm = float(np.linalg.norm(vector))
    return vector if norm <= longest else vector * (longest / norm)


@dataclass
class HandTarget:
    """One hand's target pose and the goal it moves to, in the body frame.

    Attributes:
        side: ``left`` or ``right``.
        limits: speeds and workspace.
        position, quaternion: the target as published; starts at the nominal hand pose.
        goal_position, goal_quaternion: where it is going.
    """

    side: str
    limits: TargetLimits
    position: Array = field(init=False)
    quaternion: Array = field(init=False)
    goal_position: Array = field(init=False)
    goal_quaternion: Array = field(init=False)
    _velocity: Array = field(init=False, default_factory=lambda: np.zeros(3))
    _rate: Array = field(init=False, default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        roll = NOMINAL_ROLL if self.side == "left" else -NOMINAL_ROLL
        self.place(np.array(NOMINAL_HAND_IN_BODY[self.side]), hand_quaternion(roll, 0.0, 0.0))

    def place(self, position: Array, quaternion: Array) -> None:
        """Set target and goal at once, at rest: for a start, never in the middle of a motion."""
        self.position = self.limits.clamp(self.side, position)
        self.quaternion = quaternion
        self.goal_position, self.goal_quaternion = self.position, self.quaternion
        self._velocity, self._rate = np.zeros(3), np.zeros(3)

    def go_to(self, position: Array, quaternion: Array) -> None:
        """Set the goal; it is clamped to the workspace."""
        self.goal_position = self.limits.clamp(self.side, position)
        self.goal_quaternion = quaternion

    def shift(self, step: Array) -> None:
        """Move the goal by ``step`` (3,) [m], at most ``lead_distance`` ahead of the target.

        The lead keeps a held key from piling up a long motion that goes on after its release.
        """
        lead = self.goal_position + step - self.position
        ahead = max(
            self.limits.lead_distance, float(np.linalg.norm(self.goal_position - self.position))
        )
        goal = self.position + _shortened(lead, ahead)
        self.goal_position = self.limits.clamp(self.side, goal)

    def turn(self, rotation: Array) -> None:
        """Turn the goal by ``rotation`` (3,) [rad] about body axes; ``lead_angle`` at most."""
        ahead = max(
            self.limits.lead_angle,
            float(np.linalg.norm(rotation_vector(self.quaternion, self.goal_quaternion))),
        )
        lead = rotation_vector(self.quaternion, rotate(self.goal_quaternion, rotation))
        self.goal_quaternion = rotate(self.quaternion, _shortened(lead, ahead))

    def approach(self, dt: float) -> None:
        """Move smoothly towards the goal for ``dt`` [s]: limited speed and acceleration."""
        limits = self.limits
        self._velocity = _pursue(
            self.goal_position - self.position,
            self._velocity,
            limits.linear_speed,
            limits.linear_acceleration * dt,
            limits.settling,
        )
        self._rate = _pursue(
            rotation_vector(self.quaternion, self.goal_quaternion),
            self._rate,
            limits.angular_speed,
            limits.angular_acceleration * dt,
            limits.settling,
        )
        self.position = limits.clamp(self.side, self.position + self._velocity * dt)
        self.quaternion = rotate(self.quaternion, self._rate * dt)

    def follow(self, dt: float) -> None:
        """Move straight to the goal for ``dt`` [s], as far as the speed limits let it."""
        step = _shortened(self.goal_position - self.position, self.limits.linear_speed * dt)
        turn = rotation_vector(self.quaternion, self.goal_quaternion)
        self.position = self.position + step
        self.quaternion = rotate(self.quaternion, _shortened(turn, self.limits.angular_speed * dt))

    @property
    def distance(self) -> float:
        """From the target to its goal [m]."""
        return float(np.linalg.norm(self.goal_position - self.position))

    @property
    def angle(self) -> float:
        """From the target's orientation to its goal's [rad]."""
        return float(np.linalg.norm(rotation_vector(self.quaternion, self.goal_quaternion)))
