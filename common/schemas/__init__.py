"""Message schemas, one file per family."""

from common.schemas.base import Header, Message
from common.schemas.camera import CameraFrame
from common.schemas.health import LinkHealth, ServiceHealth
from common.schemas.operator import Gait, GaitRequest, OperatorStatus, Setpoint
from common.schemas.plant import (
    Estop,
    GuardMode,
    JointCommand,
    PlantAction,
    PlantRequest,
    PlantState,
    PlantStatus,
)
from common.schemas.wbc import ControllerState, ControlState, GaitOutcome, GaitReply

__all__ = [
    "CameraFrame",
    "ControlState",
    "ControllerState",
    "Estop",
    "Gait",
    "GaitOutcome",
    "GaitReply",
    "GaitRequest",
    "GuardMode",
    "Header",
    "JointCommand",
    "LinkHealth",
    "Message",
    "OperatorStatus",
    "PlantAction",
    "PlantRequest",
    "PlantState",
    "PlantStatus",
    "ServiceHealth",
    "Setpoint",
]
