"""Configure the keyboard operator."""

import math

from pydantic import BaseModel, ConfigDict, Field

from services.teleop.targets.hand import MotionLimits


class KeyboardConfig(BaseModel):
    """Step sizes of the keys and speeds of the targets."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    limits: MotionLimits = MotionLimits()
    distance_step: float = Field(default=0.02, gt=0.0, description="step of a hand [m]")
    angle_step: float = Field(
        default=math.radians(5.0), gt=0.0, description="step of a hand or the neck [rad]"
    )
    repeat_window: float = Field(
        default=1.0, gt=0.0, description="between two presses of a key that needs both [s]"
    )
    push_force: float = Field(
        default=80.0, gt=0.0, description="force of a push on the torso, forward [N]"
    )
    push_duration: float = Field(default=0.1, gt=0.0, le=5.0, description="[s]")
