"""Configuration that every plant shares: servo rate, torque limits, timeouts of the guard."""

from enum import StrEnum
from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

PHYSICS_RATE = 1000
"""Physics and servo steps per second of robot time [1/s]."""
PHYSICS_STEP_NS = 1_000_000_000 // PHYSICS_RATE
"""Robot time of one physics step [ns]."""


class TorqueMode(StrEnum):
    """Torque limits of the motors."""

    RELAXED = "relaxed"
    """Those of the public TRILL simulation: 200 N·m more than rated on every leg joint."""
    RATED = "rated"
    """Those of the public DRACO 3 URDF."""


class GuardConfig(BaseModel):
    """Timeouts of the command guard in robot time, and where it keeps an emergency stop."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    hold_after: float = Field(
        default=0.1, gt=0.0, description="time after which the joints hold [s]"
    )
    damp_after: float = Field(
        default=5.0, gt=0.0, description="time after which they are only damped [s]"
    )
    takeover_after: float = Field(
        default=1.0,
        gt=0.0,
        description="silence after which a controller of another name is obeyed; one of the same "
        "name, a restarted one, is obeyed as soon as the joints hold [s]",
    )
    stop_beat_timeout: float = Field(
        default=0.0,
        ge=0.0,
        description="hold the joints unless a stop button was heard within this time, 0: off [s]",
    )
    latch_file: str = Field(
        default="", description="file that keeps an emergency stop over a restart; empty: none"
    )

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.damp_after <= self.hold_after:
            raise ValueError(
                f"expected damp_after > hold_after, got {self.damp_after} <= {self.hold_after}"
            )
        return self
