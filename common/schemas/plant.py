"""State, status, commands and requests of the plant (simulated or real robot)."""

import math
from enum import IntEnum

import numpy as np
from pydantic import Field, field_validator

from common.schemas.arrays import Float64Array, JointVector, Quaternion, Vector2, Vector3
from common.schemas.base import Count, Message


class GuardMode(IntEnum):
    """How the plant's command guard treats the motors."""

    SILENT = 0
    """No command yet: joints hold the initial pose."""
    ACTIVE = 1
    """Commands are applied."""
    HOLD = 2
    """The command in force is older than 0.1 s: joints hold; a raised foot is put down first.

    A refused command alone does not change the mode.
    """
    DAMP = 3
    """The command in force is older than 5 s, or the robot has fallen: joints are only damped."""
    ESTOP = 4
    """Emergency stop, latched until it is cleared: joints are only damped."""


class PlantState(Message):
    """Robot state; ``header.stamp`` is the robot time at which it was measured."""

    base_position: Vector3 = Field(description="torso_link origin in world [m]")
    base_quaternion: Quaternion = Field(description="torso_link to world rotation (w, x, y, z)")
    base_linear_velocity: Vector3 = Field(description="torso_link origin in world [m/s]")
    base_angular_velocity: Vector3 = Field(description="of torso_link, in torso_link [rad/s]")
    joint_position: JointVector = Field(description="[rad]")
    joint_velocity: JointVector = Field(description="[rad/s]")
    joint_torque: JointVector = Field(description="torque the motors applied [N·m]")
    gripper_closure: Vector2 = Field(description="left, right; 0 open, 1 closed")
    foot_normal_force: Vector2 = Field(description="left, right ground reaction [N]")
    reset_count: int = Field(default=0, ge=0, description="Times the plant was reset")
    guard: GuardMode = Field(
        default=GuardMode.ACTIVE, description="what the motors do; the robot obeys only in ACTIVE"
    )
    fallen: bool = Field(default=False, description="the robot has fallen since the last reset")
    controller_boot: Count = Field(
        default=0, description="boot id of the controller that the plant obeys; 0: none"
    )
    torque_mode: str = Field(
        default="",
        max_length=16,
        description="torque limits of the motors, `relaxed` or `rated`; empty: not told",
    )
    stops: Count = Field(
        default=0, description="emergency stops so far, so that one that is over is noticed, too"
    )


class JointCommand(Message):
    """Joint set-points with feed-forward; ``header.stamp`` is that of the state it was made from.

    The plant applies ``torque + stiffness (q_cmd - q) + damping (dq_cmd - dq)`` at its physics
    rate, with ``q_cmd, dq_cmd`` extrapolated by ``velocity`` and ``acceleration`` from
    ``header.stamp`` to now.
    """

    position: JointVector = Field(description="[rad]")
    velocity: JointVector = Field(description="[rad/s]")
    acceleration: JointVector = Field(description="[rad/s²]")
    torque: JointVector = Field(description="feed-forward [N·m]; each knee half gets half")
    stiffness: JointVector = Field(description="[N·m/rad]")
    damping: JointVector = Field(description="[N·m·s/rad]")
    gripper_closure: Vector2 = Field(description="left, right; 0 open, 1 closed")


class PlantStatus(Message):
    """Guard mode, real-time factor and counters; age of the state behind the applied torque."""

    guard: GuardMode
    paused: bool
    fallen: bool
    real_time_factor: float = Field(ge=0.0, description="simulated / wall time, last second")
    age_at_torque_median: float = Field(ge=0.0, description="state age when applied [s]")
    age_at_torque_p99: float = Field(ge=0.0, description="[s]")
    commands_applied: int = Field(ge=0)
    commands_refused: int = Field(ge=0, description="out of range, out of order or too old")
    holds: int = Field(ge=0, description="times the guard fell back to HOLD")
    saturated_fraction: float = Field(
        ge=0.0, le=1.0, description="share of physics steps with a motor at its torque limit"
    )
    late_steps: int = Field(ge=0, description="physics steps skipped to catch up with the wall")
    controller: str = Field(
        default="", max_length=64, description="source of the commands that it obeys; empty: none"
    )
    controller_boot: Count = Field(default=0, description="boot id of that controller; 0: none")
    commands_foreign: int = Field(
        default=0, ge=0, description="commands of another controller, refused"
    )
    last_refusal: str = Field(default="", max_length=200, description="of a command; empty: none")
    stops: int = Field(default=0, ge=0, description="emergency stops latched so far")
    stopped_by: str = Field(
        default="", max_length=64, description="source of the stop that is latched; empty: none"
    )
    stop_reason: str = Field(default="", max_length=200, description="of the stop that is latched")
    divergences: int = Field(
        default=0, ge=0, description="times the physics diverged and the plant reset itself"
    )


class PlantAction(IntEnum):
    """Action of a :class:`PlantRequest`."""

    RESET = 0
    PAUSE = 1
    RESUME = 2
    PUSH = 3


MAX_PUSH = 2000.0
"""Largest force of a push: it throws the robot over, and the physics still bears it [N]."""


class PlantRequest(Message):
    """Request to the (simulated) plant to reset, pause, resume or push the torso."""

    action: PlantAction
    force: Vector3 = Field(
        default_factory=lambda: np.zeros(3),
        description="for PUSH: on the torso, in world, 2000 at most [N]",
    )
    duration: float = Field(default=0.1, gt=0.0, le=5.0, description="for PUSH [s]")
    seed: int = Field(
        default=-1, ge=-1, description="for RESET: of the new start; -1 takes the next one"
    )

    @field_validator("force")
    @classmethod
    def _bounded(cls, force: Float64Array) -> Float64Array:
        norm = math.hypot(*force)
        if norm > MAX_PUSH:
            raise ValueError(f"expected a push of at most {MAX_PUSH:g} N, got {norm:g} N")
        return force


class Estop(Message):
    """State of an emergency stop button.

    Pressed, it is sent again and again until the plant's status confirms the stop, which the plant
    latches until an :class:`EstopClear`. Not pressed, it says that the button could be pressed.
    """

    reason: str = Field(max_length=200)
    pressed: bool = Field(default=True, description="False: the button is there and not pressed")


class EstopClear(Message):
    """A person's command to end an emergency stop; nothing else ends one."""

    reason: str = Field(max_length=200)
    stops: int = Field(
        ge=1, description="`PlantStatus.stops` of the stop that is meant; a later one stays latched"
    )
