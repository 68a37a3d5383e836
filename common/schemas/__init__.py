"""Message schemas, one file per family.

A field that is added gets a default, so that older logs and senders stay readable; see
:mod:`common.wire.compatibility` for what else two versions of a schema may differ in. A field that
a reader must not ignore is added without one. A field that changes its meaning but neither name
nor type, for instance its frame, takes a new ``VERSION`` of its message.
"""

from common.schemas.authority import (
    AuthorityChange,
    AuthorityState,
    OperatorClaim,
    OperatorKind,
)
from common.schemas.base import NOBODY, Header, Message, Sender
from common.schemas.camera import CameraFrame
from common.schemas.device import DeviceInput, HandController
from common.schemas.episode import EpisodeAction, EpisodeMark
from common.schemas.health import (
    Heartbeat,
    LinkHealth,
    OutputHealth,
    PeerHealth,
    ServiceHealth,
    StageTime,
)
from common.schemas.journal import InputSource, StepJournal
from common.schemas.link import LinkChange
from common.schemas.operator import Gait, GaitRequest, OperatorStatus, Setpoint
from common.schemas.plant import (
    Estop,
    EstopClear,
    GuardMode,
    JointCommand,
    PlantAction,
    PlantRequest,
    PlantState,
    PlantStatus,
)
from common.schemas.policy import PolicyMode, PolicyState
from common.schemas.task import (
    SceneJoint,
    ScenePose,
    SceneState,
    TaskStage,
    TaskStatus,
    TaskVerdict,
    UndesiredContact,
)
from common.schemas.wbc import ControllerState, ControlState, GaitOutcome, GaitReply

__all__ = [
    "NOBODY",
    "AuthorityChange",
    "AuthorityState",
    "CameraFrame",
    "ControlState",
    "ControllerState",
    "DeviceInput",
    "EpisodeAction",
    "EpisodeMark",
    "Estop",
    "EstopClear",
    "Gait",
    "GaitOutcome",
    "GaitReply",
    "GaitRequest",
    "GuardMode",
    "HandController",
    "Header",
    "Heartbeat",
    "InputSource",
    "JointCommand",
    "LinkChange",
    "LinkHealth",
    "Message",
    "OperatorClaim",
    "OperatorKind",
    "OperatorStatus",
    "OutputHealth",
    "PeerHealth",
    "PlantAction",
    "PlantRequest",
    "PlantState",
    "PlantStatus",
    "PolicyMode",
    "PolicyState",
    "SceneJoint",
    "ScenePose",
    "SceneState",
    "Sender",
    "ServiceHealth",
    "Setpoint",
    "StageTime",
    "StepJournal",
    "TaskStage",
    "TaskStatus",
    "TaskVerdict",
    "UndesiredContact",
]
