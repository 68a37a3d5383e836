"""State of the whole-body controller, and its answers to gait requests."""

from enum import IntEnum

from pydantic import Field

from common.schemas.arrays import Vector2, Vector3
from common.schemas.base import Count, Message
from common.schemas.operator import Gait


class ControlState(IntEnum):
    """Discrete states of the locomotion state machine (numbering of Seo et al.'s public code)."""

    STAND = 0
    BALANCE = 1
    RF_CONTACT_TRANSITION_START = 2
    RF_CONTACT_TRANSITION_END = 3
    RF_SWING = 4
    LF_CONTACT_TRANSITION_START = 5
    LF_CONTACT_TRANSITION_END = 6
    LF_SWING = 7


class ControllerState(Message):
    """Discrete state, tracking errors and solver health of the controller, published every tick."""

    state: ControlState
    gait: Gait = Field(description="gait in execution; NONE while balancing")
    gait_progress: float = Field(ge=0.0, le=1.0)
    gaits_completed: int = Field(ge=0)
    dcm_error: float = Field(ge=0.0, description="|DCM - planned DCM|, horizontal [m]")
    com_in_world: Vector3
    hand_position_error: Vector2 = Field(description="left, right: |actual - target| [m]")
    hand_rotation_error: Vector2 = Field(description="left, right [rad]")
    hand_weight: float = Field(ge=0.0, description="current weight of the hand position tasks")
    setpoint_fresh: bool = Field(
        description="hand set-points arrive in time; otherwise the last is held"
    )
    solver: str = Field(max_length=32)
    unsolved: int = Field(ge=0, description="ticks whose QP was not solved, so far")
    setpoint_stamp: Count = Field(
        default=0, description="stamp of the set-point in use [ns]; 0: none"
    )
    obstacle: str = Field(
        default="",
        max_length=200,
        description="why the robot does not do what is commanded; empty: it does",
    )


class GaitOutcome(IntEnum):
    """Outcome of a gait request."""

    ACCEPTED = 0
    REFUSED = 1
    COMPLETED = 2
    ABORTED = 3


class GaitReply(Message):
    """Answer to a gait request; every request gets at least one."""

    request_id: int = Field(ge=0)
    gait: Gait
    outcome: GaitOutcome
    reason: str = Field(default="", max_length=200)
    requester_boot: Count = Field(default=0, description="boot id of the sender of the request")
