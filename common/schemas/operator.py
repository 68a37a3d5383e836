"""Set-points, gait requests and status of an operator (a person, a script or a policy)."""

from enum import IntEnum

from pydantic import Field

from common.schemas.arrays import Quaternion, Vector2, Vector3
from common.schemas.base import Count, Message


class Gait(IntEnum):
    """The predefined gait sequences, numbered as in the public TRILL action space."""

    NONE = 0
    FORWARD = 1
    BACKWARD = 2
    SIDE_LEFT = 3
    SIDE_RIGHT = 4
    TURN_LEFT = 5
    TURN_RIGHT = 6


class Setpoint(Message):
    """Hand poses in the body frame (torso_link), gripper closures and neck pitch, at 20 Hz."""

    left_hand_position_in_body: Vector3 = Field(description="[m]")
    left_hand_quaternion_in_body: Quaternion
    right_hand_position_in_body: Vector3 = Field(description="[m]")
    right_hand_quaternion_in_body: Quaternion
    gripper_closure: Vector2 = Field(description="left, right; 0 open, 1 closed")
    neck_pitch: float = Field(default=0.0, description="head pitch, positive looks down [rad]")


class GaitRequest(Message):
    """Request for one gait; accepted only while balancing, always answered by a GaitReply."""

    request_id: int = Field(ge=0, description="chosen by the sender, echoed in every reply")
    gait: Gait
    controller_boot: Count = Field(
        default=0,
        description="boot id of the controller that was first asked; another one answers ABORTED, "
        "for it cannot know what became of the gait; 0: any",
    )


class OperatorStatus(Message):
    """Progress of a scripted operator; published at 5 Hz and at every change."""

    script: str = Field(max_length=64, description="name of the script")
    step: int = Field(ge=0, description="top-level steps done")
    steps: int = Field(ge=0, description="top-level steps in all")
    label: str = Field(default="", max_length=200, description="last mark the script made")
    finished: bool = Field(description="the script has ended, well or not")
    failed: str = Field(
        default="", max_length=200, description="why it failed; empty if it did not"
    )
    slipping: bool = Field(
        default=False,
        description="a hand is being knocked off its way: nobody means it to go there",
    )
