"""Mapping from samples of headset and hand controllers to set-points and gait requests; pure.

A hand moves only while its clutch (squeeze) is held. Engaging takes a snapshot of the controller,
the head's yaw and the hand's target. From then on the target is the snapshot's plus the motion of
the controller since, in the yaw frame of the snapshot. Engaging therefore never makes a target
jump, and motion of the head never moves a hand. When the squeeze is released, tracking is lost or
samples cease, the hand holds its target until it is engaged again.
"""

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from common.robot.joints import JOINTS, NECK
from common.robot.pose import Pose
from common.robot.rotations import (
    multiply,
    normalised,
    quaternion_from_rotation_vector,
    rotate_about_z,
    rotation_between,
    rpy_from_quaternion,
)
from common.robot.workspace import clamp_to_workspace
from common.schemas import DeviceInput, Gait, GaitRequest, HandController, Header, Setpoint
from common.schemas.arrays import Float64Array as Array
from common.topics import TELEOP_DEVICE
from services.teleop.targets.hand import nominal_pose


class MapperConfig(BaseModel):
    """Configuration of the mapping."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    scale: float = Field(
        default=1.0, gt=0.0, le=3.0, description="robot's motion / operator's motion"
    )
    engage: float = Field(
        default=0.6, gt=0.0, le=1.0, description="squeeze above which a clutch engages"
    )
    release: float = Field(
        default=0.4, ge=0.0, lt=1.0, description="squeeze below which a clutch releases"
    )
    meet: float = Field(
        default=0.1,
        ge=0.0,
        le=1.0,
        description="distance to the gripper's closure at which an engaged trigger takes over",
    )
    stale_after: float = Field(
        default=TELEOP_DEVICE.max_age,
        gt=0.0,
        description="silence after which the clutches release [s]",
    )
    head_moves_neck: bool = Field(
        default=True, description="whether the robot's neck follows the head's pitch"
    )


class Button(Enum):
    """Buttons that request gaits: hand and name in the sample."""

    LEFT_UPPER = ("left", "upper")
    RIGHT_UPPER = ("right", "upper")
    LEFT_LOWER = ("left", "lower")
    RIGHT_LOWER = ("right", "lower")
    LEFT_STICK = ("left", "stick_pressed")
    RIGHT_STICK = ("right", "stick_pressed")

    def held(self, device: DeviceInput) -> bool:
        """Return whether the button is pressed in a sample."""
        hand, button = self.value
        return bool(getattr(getattr(device, hand), button))


GAIT_BUTTONS: dict[Button, Gait] = {
    Button.LEFT_UPPER: Gait.FORWARD,
    Button.RIGHT_UPPER: Gait.BACKWARD,
    Button.LEFT_STICK: Gait.SIDE_LEFT,
    Button.RIGHT_STICK: Gait.SIDE_RIGHT,
    Button.LEFT_LOWER: Gait.TURN_LEFT,
    Button.RIGHT_LOWER: Gait.TURN_RIGHT,
}
"""Y walks forward, B backward, X turns left, A right, pressed thumb sticks side-step."""


@dataclass
class _Snapshot:
    """Controller, head yaw and target at the time of engaging."""

    controller_position: Array
    controller_quaternion: Array
    yaw: float
    target: Pose


def head_yaw(quaternion: Array) -> float:
    """Return the heading of the head [rad].

    It is that of the forward axis, or of the up axis if the head looks straight down or up.

    Args:
        quaternion: (4,) head to floor (w, x, y, z).
    """
    w, x, y, z = quaternion.tolist()
    forward = (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z))
    if math.hypot(*forward) > 0.1:
        return math.atan2(forward[1], forward[0])
    down = 2.0 * (x * z - w * y) < 0.0
    up = (2.0 * (x * z + w * y), 2.0 * (y * z - w * x))
    sign = 1.0 if down else -1.0
    return math.atan2(sign * up[1], sign * up[0])


class HandMapper:
    """Maps one hand: clutch, target and gripper.

    While the clutch is held the target may leave the workspace, in which the controller keeps the
    hand. On release the target returns to the workspace, so that the hand follows at once when the
    clutch is engaged again.

    Attributes:
        side: ``left`` or ``right``.
        target: pose in the body frame.
        closure: of the gripper, 0 open to 1 closed.
    """

    def __init__(self, side: str, config: MapperConfig) -> None:
        self.side = side
        self._config = config
        self.target = nominal_pose(side)
        self.closure = 0.0
        self._snapshot: _Snapshot | None = None
        self._trigger_met = False
        self._last_trigger = 0.0

    @property
    def engaged(self) -> bool:
        """Whether the hand follows its controller."""
        return self._snapshot is not None

    def release(self) -> None:
        """Hold the target, within the workspace, until the clutch is engaged again."""
        self._snapshot = None
        position = clamp_to_workspace(self.side, self.target.position)
        self.target = Pose(position, self.target.quaternion)

    def update(self, controller: HandController, yaw: float | None) -> None:
        """Apply a sample; ``yaw`` is the head's [rad], None if it is not tracked."""
        limit = self._config.release if self.engaged else self._config.engage
        if not controller.tracked or controller.squeeze < limit:
            self.release()
            return
        if self._snapshot is None:
            if yaw is None:
                return
            self._engage(controller, yaw)
        else:
            self._follow(self._snapshot, controller)
        self._grip(controller.trigger)

    def _engage(self, controller: HandController, yaw: float) -> None:
        self._snapshot = _Snapshot(
            controller.position,
            controller.quaternion,
            yaw,
            self.target,
        )
        self._trigger_met = False
        self._last_trigger = controller.trigger

    def _follow(self, snapshot: _Snapshot, controller: HandController) -> None:
        moved = controller.position - snapshot.controller_position
        position = snapshot.target.position + self._config.scale * rotate_about_z(
            moved, -snapshot.yaw
        )
        turn = rotation_between(snapshot.controller_quaternion, controller.quaternion)
        delta = quaternion_from_rotation_vector(rotate_about_z(turn, -snapshot.yaw))
        quaternion = normalised(multiply(delta, snapshot.target.quaternion))
        self.target = Pose(position, quaternion)

    def _grip(self, trigger: float) -> None:
        """Let the gripper follow the trigger once that has met the closure left before."""
        low, high = sorted((self._last_trigger, trigger))
        meet = self._config.meet
        self._trigger_met = self._trigger_met or low - meet <= self.closure <= high + meet
        self._last_trigger = trigger
        if self._trigger_met:
            self.closure = trigger


class HeadsetMapper:
    """Maps one operator's samples; pure, driven by explicit times.

    Attributes:
        hands: by side.
        neck: head pitch, positive looks down [rad].
        next_id: of the next gait request.
    """

    def __init__(self, config: MapperConfig | None = None, first_id: int = 0) -> None:
        self.config = config or MapperConfig()
        self.hands = {side: HandMapper(side, self.config) for side in ("left", "right")}
        self.neck = 0.0
        self.next_id = first_id
        self._held: frozenset[Button] = frozenset(Button)
        self._last: float | None = None

    def adopt(self, setpoint: Setpoint) -> None:
        """Continue from another's set-point; a clutch that is held engages anew from there."""
        poses = {
            "left": (setpoint.left_hand_position_in_body, setpoint.left_hand_quaternion_in_body),
            "right": (setpoint.right_hand_position_in_body, setpoint.right_hand_quaternion_in_body),
        }
        closures = np.clip(setpoint.gripper_closure, 0.0, 1.0).tolist()
        for (side, (position, quaternion)), closure in zip(poses.items(), closures, strict=True):
            hand = self.hands[side]
            hand.target, hand.closure = Pose(position, quaternion), closure
            hand.release()
        self.neck = setpoint.neck_pitch

    def update(self, device: DeviceInput | None, now: float) -> list[GaitRequest]:
        """Apply a sample and return the gaits that it requests.

        Args:
            device: the sample; None: there is no new one.
            now: time on any steady clock [s].
        """
        if device is None:
            if self._last is None or now - self._last > self.config.stale_after:
                self._release()
            return []
        self._last = now
        yaw = head_yaw(device.head_quaternion) if device.head_tracked else None
        self.hands["left"].update(device.left, yaw)
        self.hands["right"].update(device.right, yaw)
        if device.head_tracked and self.config.head_moves_neck:
            _, pitch, _ = rpy_from_quaternion(device.head_quaternion)
            neck = JOINTS[NECK.start]
            self.neck = min(max(pitch, neck.lower), neck.upper)
        return self._gaits(device)

    def setpoint(self, stamp: int = 0) -> Setpoint:
        """Return the set-point; ``stamp`` is the robot time of what the operator saw [ns]."""
        left, right = self.hands["left"], self.hands["right"]
        return Setpoint(
            header=Header(stamp=stamp),
            left_hand_position_in_body=left.target.position,
            left_hand_quaternion_in_body=left.target.quaternion,
            right_hand_position_in_body=right.target.position,
            right_hand_quaternion_in_body=right.target.quaternion,
            gripper_closure=np.array([left.closure, right.closure]),
            neck_pitch=self.neck,
        )

    def _release(self) -> None:
        for hand in self.hands.values():
            hand.release()
        # A button held during the silence is not a press in the first sample after it.
        self._held = frozenset(Button)

    def _gaits(self, device: DeviceInput) -> list[GaitRequest]:
        """Return a request for each button that went down with this sample."""
        held = frozenset(button for button in Button if button.held(device))
        pressed = [button for button in Button if button in held - self._held]
        self._held = held
        requests = []
        for button in pressed:
            gait = GAIT_BUTTONS[button]
            requests.append(
                GaitRequest(
                    header=Header(stamp=device.header.stamp), request_id=self.next_id, gait=gait
                )
            )
            self.next_id += 1
        return requests


def from_local_floor(position: Array, quaternion: Array) -> tuple[Array, Array]:
    """Convert a pose in WebXR's ``local-floor`` space (x right, y up, z back).

    Args:
        position: (3,) [m].
        quaternion: (4,) scalar first.

    Returns:
        position (3,) and quaternion (4,) in a frame with x forward, y left and z up; the axes of
        head or grip are renamed likewise, so that x points ahead.
    """
    right, up, back = position.tolist()
    w, x, y, z = quaternion.tolist()
    return np.array([-back, -right, up]), np.array([w, -z, -x, y])
