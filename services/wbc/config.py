"""Configuration of the whole-body controller.

Gains and weights are those of a DRACO 3 walking study with this controller. They are softer than
the public TRILL values (CoM 400/20, hands 400/60), which become unstable with a loop delay of more
than 10 ms.
"""

from typing import Literal

from pydantic import Field, field_validator

from common.robot.frames import FOOT_SUPPORT_HALF_SIZE
from common.topics import TELEOP_SETPOINT
from services.wbc.gains import Gains, MotorGains, StrictModel


class TaskConfig(StrictModel):
    """Weights and gains of the tasks in the QP's cost."""

    com_weight: float = Field(default=20.0, description="weight of the CoM")
    com_horizontal: Gains = Gains(kp=60.0, kd=13.0)
    com_vertical: Gains = Gains(kp=100.0, kd=20.0)
    torso_weight: float = Field(default=40.0, description="weight of the torso's orientation")
    torso: Gains = Gains(kp=100.0, kd=20.0)
    hand_position: Gains = Gains(kp=200.0, kd=28.0)
    hand_rotation: Gains = Gains(kp=150.0, kd=24.0)
    hand_weight_balancing: float = Field(
        default=20.0, description="weight of the hands while balancing; higher, as in the paper"
    )
    hand_weight_walking: float = Field(
        default=10.0, description="weight of the hands in every other state"
    )
    hand_rotation_share: float = Field(default=0.5, description="rotation weight / position weight")
    hand_weight_ramp: float = Field(
        default=0.5, gt=0.0, description="duration of a change between the two weights [s]"
    )
    foot_weight_stance: float = Field(default=60.0, description="weight of a standing foot")
    foot_weight_swing: float = Field(default=40.0, description="weight of a swinging foot")
    foot: Gains = Gains(kp=300.0, kd=30.0)
    posture_weight: float = Field(default=0.02, description="weight of the arms' joints")
    posture_shoulder: Gains = Gains(kp=50.0, kd=20.0)
    posture_elbow: Gains = Gains(kp=25.0, kd=12.0)
    posture_wrist: Gains = Gains(kp=20.0, kd=8.0)
    neck_weight: float = Field(default=1.0, description="weight of the neck joint")
    neck: Gains = Gains(kp=100.0, kd=20.0)
    acceleration_regulariser: float = Field(
        default=1e-4, description="weight of all joint accelerations"
    )
    force_regulariser: float = Field(default=1e-6, description="weight of the reaction forces")
    force_reference_weight: float = Field(
        default=1e-6, description="weight of the planned distribution of the normal forces"
    )


class ContactConfig(StrictModel):
    """Contact model of a foot."""

    friction: float = Field(
        default=0.3, gt=0.0, description="friction coefficient of the cone, below the floor's"
    )
    half_length: float = Field(
        default=FOOT_SUPPORT_HALF_SIZE[0], gt=0.0, description="of the support rectangle in x [m]"
    )
    half_width: float = Field(
        default=FOOT_SUPPORT_HALF_SIZE[1], gt=0.0, description="of the support rectangle in y [m]"
    )
    normal_force_max: float = Field(
        default=1000.0, gt=0.0, description="limit for a fully loaded foot [N]"
    )


class LimitConfig(StrictModel):
    """Bounds inside the QP."""

    torque_mode: Literal["relaxed", "rated"] = Field(
        default="relaxed", description="motor torque limits; the same as the plant's"
    )
    acceleration_max: float = Field(default=600.0, gt=0.0, description="of every joint [rad/s²]")
    joint_margin: float = Field(
        default=0.03, ge=0.0, description="distance of the arms' barrier from the limits [rad]"
    )
    joint_stiffness: float = Field(default=400.0, description="of the arms' barrier [1/s²]")
    joint_damping: float = Field(default=40.0, description="of the arms' barrier [1/s]")
    clearance_margin: float = Field(
        default=0.01,
        ge=0.0,
        le=0.05,
        description="distance at which the arms stop before each other and the body [m]",
    )
    clearance_stiffness: float = Field(
        default=200.0, gt=0.0, description="of the barrier between them [1/s²]"
    )
    clearance_damping: float = Field(
        default=28.0, gt=0.0, description="of the barrier between them [1/s]"
    )


class GaitConfig(StrictModel):
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
    unload_fraction: float = Field(
        default=0.4, gt=0.0, lt=1.0, description="share of a double support to unload a foot"
    )
    load_fraction: float = Field(
        default=0.3, gt=0.0, lt=1.0, description="share of a double support to load a foot"
    )
    anchor_distance: float = Field(
        default=0.04,
        description="distance of the stance from the plan beyond which a gait starts from the "
        "measured stance [m]",
    )
    anchor_angle: float = Field(default=0.09, description="likewise for the heading [rad]")

    @property
    def duration(self) -> float:
        """Duration of a gait from acceptance to completion [s]."""
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
"""Timing of the named paces: 2.2 s, 3.35 s, 3.95 s and, as in public TRILL, 6.1 s a gait."""


class HandConfig(StrictModel):
    """Interpolation of hand set-points.

    Tremor is filtered by the distance of each set-point from its prediction and by the hand's
    speed. While both are below the thresholds named tremor and movement, the gain is
    ``tremor_gain``; it rises to 1 where one of them reaches ``movement_ratio`` times its threshold.
    """

    mode: Literal["interpolate", "raw"] = Field(
        default="interpolate", description="raw: the reference jumps to each set-point"
    )
    setpoint_period: float = Field(default=0.05, gt=0.0, description="between set-points [s]")
    speed_max: float = Field(
        default=1.0, gt=0.0, description="limit of the reference's linear speed [m/s]"
    )
    turn_rate_max: float = Field(
        default=4.0, gt=0.0, description="limit of the reference's angular speed [rad/s]"
    )
    feedforward_speed_max: float = Field(
        default=0.6, ge=0.0, description="limit of the estimated linear velocity [m/s]"
    )
    feedforward_rate_max: float = Field(
        default=2.5, ge=0.0, description="limit of the estimated angular velocity [rad/s]"
    )
    tremor: float = Field(
        default=0.002, gt=0.0, description="largest distance from the prediction by tremor [m]"
    )
    tremor_angle: float = Field(default=0.015, gt=0.0, description="likewise, rotation [rad]")
    tremor_gain: float = Field(
        default=0.4, gt=0.0, le=1.0, description="filter gain under tremor; 1: no filter"
    )
    movement_speed: float = Field(
        default=0.04, gt=0.0, description="linear speed of the slowest movement [m/s]"
    )
    movement_rate: float = Field(
        default=0.24, gt=0.0, description="angular speed of the slowest movement [rad/s]"
    )
    movement_ratio: float = Field(
        default=2.5,
        gt=1.0,
        description="multiple of the thresholds above which set-points are followed unfiltered",
    )
    stale_after: float = Field(
        default=TELEOP_SETPOINT.max_age,
        gt=0.0,
        description="age of the last set-point after which the hands hold [s]; unless given here, "
        "`[runtime] max_age` of `teleop/setpoint` rules",
    )


class AuthorityConfig(StrictModel):
    """Which of several operators has the robot, and how it changes hands."""

    lease: float = Field(
        default=1.0,
        ge=0.25,
        description="time without a claim of the operator that has the robot, after which nobody "
        "has it [s]",
    )
    ranks: tuple[Literal["person", "script", "policy"], ...] = Field(
        default=("person", "script", "policy"),
        description="kinds of operators, the one that goes before the others first",
    )
    blend_time: float = Field(
        default=1.0,
        ge=0.0,
        description="shortest time in which the targets go over to those of a new operator [s]",
    )
    blend_speed: float = Field(
        default=0.25, gt=0.0, description="limit of a hand's mean speed in it [m/s]"
    )
    blend_turn_rate: float = Field(
        default=1.047, gt=0.0, description="likewise, rotation: 60 degrees a second [rad/s]"
    )

    @field_validator("ranks")
    @classmethod
    def _complete(cls, ranks: tuple[str, ...]) -> tuple[str, ...]:
        if sorted(ranks) != ["person", "policy", "script"]:
            raise ValueError(f"expected person, script and policy, each once; got {list(ranks)}")
        return ranks


class WbcConfig(StrictModel):
    """Configuration of the controller."""

    rate: float = Field(default=100.0, ge=20.0, le=1000.0, description="[Hz]")
    solver: Literal["osqp", "daqp", "quadprog"] = Field(
        default="osqp", description="of the QP, where the compiled dual method is not built"
    )
    tasks: TaskConfig = TaskConfig()
    contact: ContactConfig = ContactConfig()
    limits: LimitConfig = LimitConfig()
    gait: GaitConfig = GaitConfig()
    hands: HandConfig = HandConfig()
    motors: MotorGains = MotorGains()
    authority: AuthorityConfig = AuthorityConfig()
    stand_time: float = Field(default=1.0, gt=0.0, description="to reach the stance at start [s]")
    qp_dump_dir: str = Field(default="", description="directory for unsolved QPs; empty: none")


def wbc_config(
    mode: Literal["relaxed", "rated"] = "relaxed", pace: str = "", **overrides: object
) -> WbcConfig:
    """Return the configuration for a torque mode and a pace.

    ``rated`` (the URDF's torques) needs a taller stance and the slow pace: at a CoM height of
    0.70 m single support needs 110 N·m in a knee coordinate that has 81.7.

    Args:
        mode: torque mode.
        pace: one of :data:`PACES`; empty: normal, or slow if rated.
        **overrides: values of top-level fields.

    Raises:
        ValueError: a pace or field is unknown.
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
