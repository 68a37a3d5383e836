"""State of a policy that operates the robot."""

from enum import IntEnum

from pydantic import Field

from common.schemas.base import Count, Message


class PolicyMode(IntEnum):
    """What a policy is doing."""

    WAITING = 0
    """It does not have the robot, or the robot does not balance yet."""
    OK = 1
    """It plans and acts."""
    DEGRADED = 2
    """An input or an answer is late; what was planned before goes on."""
    STARVED = 3
    """The plan has run out: the hands hold, a gait in progress ends, the balance goes on."""
    RECONNECTING = 4
    """The inference server did not answer in time and is asked again; the hands hold."""


class PolicyState(Message):
    """State of a policy, published at 5 Hz and at every change of its mode."""

    policy: str = Field(max_length=64, description="kind of the policy, for instance trill")
    checkpoint: str = Field(max_length=64, description="SHA-256 of its manifest")
    mode: PolicyMode
    label: str = Field(default="", max_length=200, description="what it does or waits for")
    state_age: float = Field(
        default=-1.0, ge=-1.0, description="since the robot's state arrived [s]; -1: none yet"
    )
    picture_age: float = Field(
        default=-1.0,
        ge=-1.0,
        description="of the pictures behind the robot's state, in robot time [s]; -1: none",
    )
    delay: float = Field(
        default=-1.0,
        ge=-1.0,
        description="from the robot's state to the set-point made from it in use, round trip over "
        "the links [s]; -1: not known",
    )
    compensated: int = Field(
        default=0, ge=0, description="steps of a chunk skipped because of the delay"
    )
    round_trip: float = Field(
        default=-1.0, ge=-1.0, description="from the last request to its answer [s]; -1: none yet"
    )
    inference: float = Field(
        default=-1.0,
        ge=-1.0,
        description="of the last answer, measured by the server [s]; -1: in the policy's own step",
    )
    answers: Count = Field(default=0, description="plans made so far")
    late: Count = Field(default=0, description="answers dropped: nothing of their plan was left")
    unasked: Count = Field(
        default=0, description="answers dropped: to no open request, or a second one to it"
    )
    refused: Count = Field(default=0, description="answers dropped: errors, or not decodable")
    unanswered: Count = Field(default=0, description="requests given up without an answer")
    gaits: Count = Field(default=0, description="gaits requested so far")
