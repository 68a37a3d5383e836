"""Raw input of an operator's headset and hand controllers."""

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from common.schemas.arrays import Quaternion, Vector2, Vector3
from common.schemas.base import Message


class HandController(BaseModel):
    """Pose and buttons of one hand controller.

    Poses are in the operator's floor frame: origin on the floor of the operator's room, x forward,
    y left, z up (WebXR's ``local-floor`` with its axes renamed).
    """

    model_config = ConfigDict(
        frozen=True, extra="forbid", arbitrary_types_allowed=True, allow_inf_nan=False
    )

    position: Vector3 = Field(description="of the grip in the operator's floor frame [m]")
    quaternion: Quaternion = Field(description="grip to floor rotation (w, x, y, z)")
    tracked: bool = Field(description="the pose is measured, not guessed")
    trigger: float = Field(default=0.0, ge=0.0, le=1.0, description="index finger; 1 pressed")
    squeeze: float = Field(default=0.0, ge=0.0, le=1.0, description="middle finger; 1 pressed")
    lower: bool = Field(default=False, description="button A (right) or X (left)")
    upper: bool = Field(default=False, description="button B (right) or Y (left)")
    stick: Vector2 = Field(
        default_factory=lambda: np.zeros(2), description="thumb stick: right, forward; -1 to 1"
    )
    stick_pressed: bool = Field(default=False, description="thumb stick pushed in")


class DeviceInput(Message):
    """One sample of a headset and two hand controllers, at 20 Hz or the headset's own rate.

    ``header.stamp`` is the robot time of what the operator saw.
    """

    device: str = Field(max_length=64, description="webxr, synthetic, ...")
    head_position: Vector3 = Field(description="in the operator's floor frame [m]")
    head_quaternion: Quaternion = Field(description="head to floor rotation; x looks ahead")
    head_tracked: bool
    left: HandController
    right: HandController
