"""Configuration of the whole-body controller.

Gains and weights are those of a DRACO 3 walking study on this controller: softer than the public
TRILL values (CoM 400/20, hands 400/60), which lose their margin beyond 10 ms of loop delay.
"""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from common.robot.frames import FOOT_SUPPORT_HALF_SIZE


class _Config(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Gains(_Config):
    """PD gains: of a task [1/s², 1/s], of a motor [N·m/rad, N·m·s/rad]."""

    kp: float = Field(ge=0.0, description="stiffness")
    kd: float = Field(ge=0.0, description="damping")


class TaskConfig(_Config):
    """Weights and gains of the tasks in the QP's cost."""

    com_weight: float = Field(default=20.0, description="of the CoM task")
    com_horizontal: Gains = Gains(kp=60.0, kd=13.0)
    com_vertical: Gains = Gains(kp=100.0, kd=20.0)
    torso_weight: float = Field(default=40.0, description="of the torso's orientation")
    torso: Gains = Gains(kp=100.0, kd=20.0)
    hand_position: Gains = Gains(kp=200.0, kd=28.0)
    hand_rotation: Gains = Gains(kp=150.0, kd=24.0)
    hand_weight_balancing: float = Field(
        default=20.0, description="raised while balancing, as the paper says; not in its code"
    )
    hand_weight_walking: float = Field(default=10.0, description="of a hand's position")
    hand_rotation_share: float = Field(default=0.5, description="rotation weight / position weight")
    hand_weight_ramp: float = Field(default=0.5, gt=0.0, description="time from one to other [s]")
    foot_weight_stance: float = Field(default=60.0, description="of a foot on the ground")
    foot_weight_swing: float = Field(default=40.0, description="of a foot in the air")
    foot: Gains = Gains(kp=300.0, kd=30.0)
    posture_weight: float = Field(default=0.02, description="of the arms' joint posture")
    posture_shoulder: Gains = Gains(kp=50.0, kd=20.0)
    posture_elbow: Gains = Gains(kp=25.0, kd=12.0)
    posture_wrist: Gains = Gains(kp=20.0, kd=8.0)
    neck_weight: float = Field(default=1.0, description="of the neck joint")
    neck: Gains = Gains(kp=100.0, kd=20.0)
    acceleration_regulariser: float = Field(
        default=1e-4, description="weight of all joint accelerations"
    )
    force_regulariser: float = Field(default=1e-6, description="weight of the reaction forces")
    force_reference_weight: float = Field(
        default=1e-6, description="pull of the reaction forces towards the planned share of weight"
    )


class ContactConfig(_Config):
    """Contact model of a foot."""

    friction: float = Field(
        default=0.3, gt=0.0, description="assumed by the cone, below the floor's"
    )
    half_length: float = Field(
        default=FOOT_SUPPORT_HALF_SIZE[0], gt=0.0, description="support polygon along x [m]"
    )
    half_width: float = Field(default=FOOT_SUPPORT_HALF_SIZE[1], gt=0.0, description="along y [m]")
    normal_force_max: float = Field(default=1000.0, gt=0.0, description="of a loaded foot [N]")


class LimitConfig(_Config):
    """Bounds inside the QP."""

    torque_mode: Literal["relaxed", "rated"] = Field(
        default="relaxed", description="motor torque limits; the plant's must be the same"
    )
    acceleration_max: float = Field(default=600.0, gt=0.0, description="any joint [rad/s²]")
    joint_margin: float = Field(default=0.03, ge=0.0, description="kept from arm limits [rad]")
    joint_stiffness: float = Field(default=400.0, description="of the arm limit barrier [1/s²]")
    joint_damping: float = Field(default=40.0, description="of the arm limit barrier [1/s]")


class GaitConfig(_Config):
    """Geometry and timing of a gait (two steps)."""

    com_height: float = Field(default=0.70, ge=0.55, le=0.74, description="above the soles [m]")
    stance_width: float = Field(default=0.28, gt=0.15, lt=0.4, description="between soles [m]")
    swing_height: float = Field(default=0.05, gt=0.0, lt=0.2, description="[m]")
    forward_step: float = Field(default=0.2, description="[m]")
    backward_step: float = Field(default=0.2, description="[m]")
    side_step: float = Field(default=0.1, description="[m]")
    turn_angle: float = Field(default=0.3141592653589793, description="18 degrees [rad]")
    initial_transfer: float = Field(default=0.8, gt=0.2, description="first double support [s]")
    single_support: float = Field(default=0.65, gt=0.2, description="swing time [s]")
    double_support: float = Field(default=0.35, gt=0.05, description="between the steps [s]")
    final_transfer: float = Field(default=0.5, gt=0.1, description="last double support [s]")
    settle: float = Field(default=0.4, ge=0.0, description="rest before the next gait [s]")
    unload_fraction: float = Field(default=0.4, gt=0.0, lt=1.0, description="of a double support")
    load_fraction: float = Field(default=0.3, gt=0.0, lt=1.0, description="of a double support")
    anchor_distance: float = Field(
        default=0.04, description="a stance further off plan than this re-anchors the plan [m]"
    )
    anchor_angle: float = Field(default=0.09, description="likewise [rad]")

    @property
    def duration(self) -> float:
        """Time one gait takes from acceptance to completion [s]."""
        steps = 2.0 * self.single_support + self.double_support
        return self.initial_transfer + steps + self.final_transfer + self.settle


PACES: dict[str, dict[str, float]] = {
    "fast": {
        "initial_transfer": 0.5,
        "single_support": 0.5,
        "double_support": 0.2,
        "final_transfer": 0.3,
        "settle": 0.2,
    },
    "normal": {},
    "slow": {
        "initial_transfer": 1.0,
        "single_support": 0.75,
        "double_support": 0.45,
        "final_transfer": 0.6,
        "settle": 0.4,
    },
    "public": {
        "initial_transfer": 1.5,
        "single_support": 1.0,
        "double_support": 1.0,
        "final_transfer": 1.0,
        "settle": 0.6,
    },
}
"""Named paces: 2.2 s, 3.35 s, 3.95 s and (as the public TRILL code) 6.1 s a gait."""


class HandConfig(_Config):
    """How hand set-points become references."""

    mode: Literal["interpolate", "raw"] = Field(
        default="interpolate", description="raw: jump to each set-point"
    )
    setpoint_period: float = Field(default=0.05, gt=0.0, description="between set-points [s]")
    speed_max: float = Field(default=1.0, gt=0.0, description="of the reference [m/s]")
    turn_rate_max: float = Field(default=4.0, gt=0.0, description="of the reference [rad/s]")
    feedforward_speed_max: float = Field(
        default=0.6, ge=0.0, description="cap on the velocity read off successive set-points [m/s]"
    )
    feedforward_rate_max: float = Field(default=2.5, ge=0.0, description="likewise [rad/s]")
    tremor: float = Field(
        default=0.002, gt=0.0, description="set-points this near to the expected tremble [m]"
    )
    tremor_angle: float = Field(default=0.015, gt=0.0, description="likewise [rad]")
    tremor_gain: float = Field(
        default=0.4, gt=0.0, le=1.0, description="share of it that is followed; 1: all"
    )
    movement_speed: float = Field(default=0.04, gt=0.0, description="slower may tremble [m/s]")
    movement_rate: float = Field(default=0.24, gt=0.0, description="likewise [rad/s]")
    movement_ratio: float = Field(
        default=2.5, gt=1.0, description="so many times all these is a movement, followed whole"
    )
    stale_after: float = Field(default=0.25, gt=0.0, description="then the hands hold [s]")
    x_range: tuple[float, float] = Field(
        default=(0.15, 0.56),
        description="further than a hand reaches: a push's force comes of the set-point's lead",
    )
    y_range: tuple[float, float] = Field(
        default=(-0.10, 0.45), description="of the left hand; the right is mirrored [m]"
    )
    z_range: tuple[float, float] = Field(
        default=(-0.15, 0.40),
        description="higher, near the chest, the upper arms meet it and the robot topples [m]",
    )


class MotorGains(_Config):
    """Joint PD that the plant applies around the measured state, between controller ticks."""

    hip: Gains = Gains(kp=100.0, kd=5.0)
    knee: Gains = Gains(kp=100.0, kd=5.0)
    ankle: Gains = Gains(kp=30.0, kd=1.5)
    shoulder: Gains = Gains(kp=40.0, kd=2.0)
    elbow: Gains = Gains(kp=40.0, kd=2.0)
    wrist: Gains = Gains(kp=15.0, kd=0.6)
    neck: Gains = Gains(kp=20.0, kd=1.0)


class WbcConfig(_Config):
    """Everything about the controller."""

    rate: float = Field(default=100.0, ge=20.0, le=1000.0, description="[Hz]")
    solver: Literal["osqp", "daqp", "quadprog"] = Field(default="osqp", description="of the QP")
    tasks: TaskConfig = TaskConfig()
    contact: ContactConfig = ContactConfig()
    limits: LimitConfig = LimitConfig()
    gait: GaitConfig = GaitConfig()
    hands: HandConfig = HandConfig()
    motors: MotorGains = MotorGains()
    stand_time: float = Field(default=1.0, gt=0.0, description="to reach the stance at start [s]")
    qp_dump_dir: str = Field(default="", description="unsolved QPs are written here; '' : nowhere")


def wbc_config(
    mode: Literal["relaxed", "rated"] = "relaxed", pace: str = "", **overrides: object
) -> WbcConfig:
    """Configuration for a torque mode and pace, with top-level fields overridden.

    ``rated`` (the URDF's torques) needs a taller stance and the slow pace: at a CoM height of
    0.70 m single support asks 110 N·m of a knee coordinate that has 81.7.

    Raises:
        ValueError: for an unknown pace or field.
    """
    pace = pace or ("slow" if mode == "rated" else "normal")
    if pace not in PACES:
        raise ValueError(f"unknown pace {pace!r}, expected one of {sorted(PACES)}")
    height = {"com_height": 0.73} if mode == "rated" else {}
    fields: dict[str, object] = {
        "gait": GaitConfig(**PACES[pace], **height),
        "limits": LimitConfig(torque_mode=mode),
    }
    return WbcConfig.model_validate({**fields, **overrides})
