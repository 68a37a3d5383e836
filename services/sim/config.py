"""Configuration of the simulated plant."""

from typing import Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from common.plant.config import PHYSICS_RATE, GuardConfig, TorqueMode

DEFAULT_COM_HEIGHT: dict[TorqueMode, float] = {TorqueMode.RELAXED: 0.70, TorqueMode.RATED: 0.73}
"""CoM above the soles [m]; a rated knee carries one-legged stance only if nearly straight."""


class _Config(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class NoiseConfig(_Config):
    """Standard deviations of the white Gaussian noise added to each published state."""

    position: float = Field(default=0.0, ge=0.0, description="torso position, per axis [m]")
    velocity: float = Field(default=0.0, ge=0.0, description="torso velocity, per axis [m/s]")
    orientation: float = Field(default=0.0, ge=0.0, description="torso, per axis [rad]")
    angular_velocity: float = Field(default=0.0, ge=0.0, description="per axis [rad/s]")
    joint_position: float = Field(default=0.0, ge=0.0, description="encoders [rad]")
    joint_velocity: float = Field(default=0.0, ge=0.0, description="[rad/s]")


TYPICAL_NOISE = NoiseConfig(
    position=0.002,
    velocity=0.02,
    orientation=0.0052,
    angular_velocity=0.02,
    joint_position=1e-4,
    joint_velocity=0.05,
)
"""Noise of a good estimator: 2 mm, 2 cm/s, 0.3°, 0.02 rad/s; encoders 0.1 mrad, 0.05 rad/s."""


class SimConfig(_Config):
    """Configuration of the simulated plant."""

    scene: str = Field(default="flat", description="name of the surroundings")
    task: str = Field(
        default="", description="scored task, for instance door/unlock; it sets the scene"
    )
    seed: int = Field(default=0, ge=0, description="of sensor noise and start")
    torque_mode: TorqueMode = Field(default=TorqueMode.RELAXED, description="motor torque limits")
    com_height: float | None = Field(
        default=None,
        ge=0.5,
        le=0.755,
        description="initial CoM above the soles [m]; default 0.70 relaxed, 0.73 rated",
    )
    stance_width: float = Field(
        default=0.28, ge=0.2, le=0.36, description="initial distance between the soles' centres [m]"
    )
    start_position_spread: float = Field(
        default=0.0, ge=0.0, le=0.5, description="start x, y uniform within ± this [m]"
    )
    start_yaw_spread: float = Field(
        default=0.0, ge=0.0, le=3.15, description="start yaw uniform within ± this [rad]"
    )
    task_spread: float = Field(
        default=1.0, ge=0.0, le=10.0, description="factor on what the task's own starts vary by"
    )
    physics_steps: int = Field(
        default=1, ge=1, le=10, description="physics steps of 1 ms per service step"
    )
    catch_up_steps: int = Field(
        default=20, ge=1, le=1000, description="most physics steps in one service step"
    )
    state_rate: int = Field(default=200, ge=10, le=1000, description="measured state [Hz]")
    truth_rate: int = Field(default=50, ge=1, le=1000, description="ground truth [Hz]")
    status_rate: int = Field(default=10, ge=1, le=100, description="plant status [Hz]")
    noise: NoiseConfig = NoiseConfig()
    guard: GuardConfig = GuardConfig()

    @model_validator(mode="after")
    def _rates_divide(self) -> Self:
        for name in ("state_rate", "truth_rate", "status_rate"):
            if PHYSICS_RATE % getattr(self, name):
                raise ValueError(
                    f"expected {name} to divide {PHYSICS_RATE} Hz, got {getattr(self, name)}; "
                    "for instance 50, 100, 200, 250 or 500"
                )
        if self.catch_up_steps < self.physics_steps:
            raise ValueError(
                f"expected catch_up_steps >= physics_steps, got {self.catch_up_steps} < "
                f"{self.physics_steps}"
            )
        return self

    @property
    def standing_com_height(self) -> float:
        """CoM height of the initial pose above the soles [m]."""
        return DEFAULT_COM_HEIGHT[self.torque_mode] if self.com_height is None else self.com_height
