"""From headset and hand controllers to what the robot is asked: a pure mapping, sample by sample.

A hand moves only while its clutch (squeeze) is held. Engaging takes a fresh snapshot of
controller, head yaw and the hand's present target; from then on the target is the snapshot's plus
what the controller has moved and turned since, in the head's yaw frame of the snapshot. So
engaging never jumps, and nothing the head does moves a hand. Squeeze and trigger, lost tracking
and silence all end in the same safe way: the hand holds its target until engaged anew.
"""

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from common.robot.joints import JOINTS, NECK
from common.robot.rotations import (
    Array,
    from_rotation_vector,
    multiply,
    normalised,
    rotation_vector,
    to_rpy,
)
from common.schemas import DeviceInput, Gait, GaitRequest, HandController, Header, Setpoint
from services.teleop.targets.hand import HandTarget, TargetLimits, home_pose


class MapperConfig(BaseModel):
    """How the operator's movements become the robot's."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    scale: float = Field(default=1.0, gt=0.0, le=3.0, description="robot's metre per operator's")
    engage: float = Field(default=0.6, gt=0.0, le=1.0, description="squeeze that engages")
    release: float = Field(default=0.4, ge=0.0, lt=1.0, description="squeeze that lets go")
    meet: float = Field(
        default=0.1,
        ge=0.0,
        le=1.0,
        description="after engaging a trigger works once it is this near to the gripper's closure",
    )
    stale_after: float = Field(
        default=0.25, gt=0.0, description="without a sample the clutches are released [s]"
    )
    head_moves_neck: bool = Field(default=True, description="the robot looks down as the head does")
    box_low: tuple[float, float, float] = Field(
        default=(0.15, -0.10, -0.15), description="of the left hand in the body frame [m]"
    )
    box_high: tuple[float, float, float] = Field(
        default=(0.56, 0.45, 0.40), description="likewise, the opposite corner [m]"
    )


class Button(Enum):
    """The buttons that ask for gaits, by hand."""

    LEFT_UPPER = ("left", "upper")
    RIGHT_UPPER = ("right", "upper")
    LEFT_LOWER = ("left", "lower")
    RIGHT_LOWER = ("right", "lower")
    LEFT_STICK = ("left", "stick_pressed")
    RIGHT_STICK = ("right", "stick_pressed")

    def held(self, device: DeviceInput) -> bool:
        """Whether it is pressed in this sample."""
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
"""Y forward, B backward, X turn left, A turn right, the thumb sticks pushed in side-step."""


@dataclass
class _Snapshot:
    """Controller, head yaw and target at the moment of engaging."""

    controller_position: Array
    controller_quaternion: Array
    yaw: float
    target_position: Array
    target_quaternion: Array


def head_yaw(quaternion: Array) -> float:
    """Heading [rad] of the head's forward axis; of its up axis when it looks straight down or up.

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


def turned_by_yaw(vector: Array, yaw: float) -> Array:
    """``vector`` (3,) turned about z by ``yaw`` [rad]."""
    c, s = math.cos(yaw), math.sin(yaw)
    x, y, z = vector.tolist()
    return np.array([c * x - s * y, s * x + c * y, z])


class HandMapper:
    """One hand's clutch, target and gripper.

    Attributes:
        side: ``left`` or ``right``.
        target: pose in the body frame, within the workspace.
        closure: of the gripper, 0 open to 1 closed.
    """

    def __init__(self, side: str, config: MapperConfig) -> None:
        self.side = side
        self._config = config
        limits = TargetLimits(box_low=config.box_low, box_high=config.box_high)
        self.target = HandTarget(side, limits)
        self.closure = 0.0
        self._snapshot: _Snapshot | None = None
        self._trigger_met = False
        self._last_trigger = 0.0

    @property
    def engaged(self) -> bool:
        """Whether the hand follows its controller."""
        return self._snapshot is not None

    def release(self) -> None:
        """Hold the target until engaged anew."""
        self._snapshot = None

    def take(self, controller: HandController, yaw: float | None) -> None:
        """Follow one sample; ``yaw`` is the head's [rad], None when it is not tracked."""
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
            self.target.position,
            self.target.quaternion,
        )
        self._trigger_met = False
        self._last_trigger = controller.trigger

    def _follow(self, snapshot: _Snapshot, controller: HandController) -> None:
        moved = controller.position - snapshot.controller_position
        position = snapshot.target_position + self._config.scale * turned_by_yaw(
            moved, -snapshot.yaw
        )
        turn = rotation_vector(snapshot.controller_quaternion, controller.quaternion)
        delta = from_rotation_vector(turned_by_yaw(turn, -snapshot.yaw))
        quaternion = normalised(multiply(delta, snapshot.target_quaternion))
        self.target.place(position, quaternion)

    def _grip(self, trigger: float) -> None:
        """The gripper follows the trigger once this has met the closure it was left with."""
        low, high = sorted((self._last_trigger, trigger))
        meet = self._config.meet
        self._trigger_met = self._trigger_met or low - meet <= self.closure <= high + meet
        self._last_trigger = trigger
        if self._trigger_met:
            self.closure = trigger


class HeadsetMapper:
    """The mapping for one operator; pure, driven by samples and explicit times.

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

    def home(self) -> None:
        """Put both targets to where hands rest: before the first set-point, never in a motion."""
        for side, hand in self.hands.items():
            hand.target.place(*home_pose(side))

    def take(self, device: DeviceInput | None, now: float) -> list[GaitRequest]:
        """Take in one sample, or None if there is no new one; returns the gaits asked for.

        Args:
            device: the sample.
            now: seconds on any steady clock.
        """
        if device is None:
            if self._last is None or now - self._last > self.config.stale_after:
                self._let_go()
            return []
        self._last = now
        yaw = head_yaw(device.head_quaternion) if device.head_tracked else None
        self.hands["left"].take(device.left, yaw)
        self.hands["right"].take(device.right, yaw)
        if device.head_tracked and self.config.head_moves_neck:
            _, pitch, _ = to_rpy(device.head_quaternion)
            neck = JOINTS[NECK.start]
            self.neck = min(max(pitch, neck.lower), neck.upper)
        return self._gaits(device)

    def setpoint(self, stamp: int = 0) -> Setpoint:
        """The set-point as it stands; ``stamp``: robot time of what the operator saw [ns]."""
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

    def _let_go(self) -> None:
        for hand in self.hands.values():
            hand.release()
        # A button that was down before the silence is not pressed anew by the first sample after.
        self._held = frozenset(Button)

    def _gaits(self, device: DeviceInput) -> list[GaitRequest]:
        """A request for each button that went down with this sample."""
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
    """WebXR's ``local-floor`` (x right, y up, z back) as the operator's floor frame.

    Args:
        position: (3,) [m].
        quaternion: (4,) scalar first; head and grip axes are renamed likewise, so that x looks
            ahead.

    Returns:
        position (3,) and quaternion (4,) in x forward, y left, z up.
    """
    right, up, back = position.tolist()
    w, x, y, z = quaternion.tolist()
    return np.array([-back, -right, up]), np.array([w, -z, -x, y])
