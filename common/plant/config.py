"""Settings that every plant shares: servo rate, torque limits, the guard's patience."""

from enum import StrEnum
from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

PHYSICS_RATE = 1000
"""Physics and servo steps per second of robot time [1/s]."""
PHYSICS_STEP_NS = 1_000_000_000 // PHYSICS_RATE
"""Robot time of one physics step [ns]."""


class TorqueMode(StrEnum):
    """Which torque limits the motors obey."""

    RELAXED = "relaxed"
    """The public TRILL simulation's limits: 200 N·m more than rated on every leg joint."""
    RATED = "rated"
    """The limits of the public DRACO 3 URDF."""


class GuardConfig(BaseModel):
    """Patience of the command guard, in robot time since the applied command's stamp."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    hold_after: float = Field(default=0.1, gt=0.0, description="then joints hold [s]")
    damp_after: float = Field(default=5.0, gt=0.0, description="then joints are damped [s]")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.damp_after <= self.hold_after:
            raise ValueError(
                f"expected damp_after > hold_after, got {self.damp_after} <= {self.hold_after}"
            )
        return self
