"""THE table of topics: everything on the bus is declared here and nowhere else.

Publishers, inboxes, health, the logger and the live table all derive from it. Adding a topic is
one line here and one schema in :mod:`common.schemas`. Keys are ``<robot>/<topic name>``, for a
topic with ``per_source`` ``<robot>/<topic name>/<source>``.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeVar

from common.schemas import (
    CameraFrame,
    ControllerState,
    DeviceInput,
    EpisodeMark,
    Estop,
    GaitReply,
    GaitRequest,
    Heartbeat,
    JointCommand,
    LinkChange,
    Message,
    OperatorStatus,
    PlantRequest,
    PlantState,
    PlantStatus,
    SceneState,
    ServiceHealth,
    Setpoint,
    StepJournal,
    TaskStatus,
)

M_co = TypeVar("M_co", bound=Message, covariant=True)


class Delivery(Enum):
    """How a topic is read."""

    LATEST = "latest"
    """A ring of one: a slow reader sees an older age, never a growing queue."""
    EVENT = "event"
    """FIFO: each message matters."""


class Priority(Enum):
    """Urgency on the wire, mapped to the transport's classes by the bus."""

    CONTROL = "control"
    INTERACTIVE = "interactive"
    BULK = "bulk"


@dataclass(frozen=True)
class Topic(Generic[M_co]):
    """One row of the table.

    ``rate`` is nominal [Hz], 0 for events. ``max_age`` [s] is when a reader calls the topic
    stale; what is older than that when it arrives (deliberately injected delay not counted) is
    not applied at all. It is infinite for what must never be discarded.
    """

    name: str
    schema: type[M_co]
    rate: float
    max_age: float = float("inf")
    delivery: Delivery = Delivery.LATEST
    priority: Priority = Priority.INTERACTIVE
    per_source: bool = False
    doc: str = ""


_C, _I, _B = Priority.CONTROL, Priority.INTERACTIVE, Priority.BULK
_EVENT = Delivery.EVENT

PLANT_STATE = Topic("plant/state", PlantState, 200.0, 0.1, priority=_C, doc="measured state")
PLANT_TRUTH = Topic("plant/truth", PlantState, 50.0, 0.2, doc="ground truth, for scoring only")
PLANT_STATUS = Topic("plant/status", PlantStatus, 10.0, 0.5, doc="guard, pace, state age at torque")
PLANT_REQUEST = Topic(
    "plant/request", PlantRequest, 0.0, 1.0, _EVENT, doc="reset, pause, resume, push"
)
ESTOP = Topic("estop", Estop, 0.0, delivery=_EVENT, priority=_C, doc="emergency stop, latched")
WBC_COMMAND = Topic("wbc/command", JointCommand, 100.0, 0.1, priority=_C, doc="joint command")
WBC_STATE = Topic("wbc/state", ControllerState, 100.0, 0.2, doc="state machine, errors, solver")
WBC_REPLY = Topic("wbc/reply", GaitReply, 0.0, delivery=_EVENT, doc="answers to gait requests")
TELEOP_SETPOINT = Topic("teleop/setpoint", Setpoint, 20.0, 0.25, doc="hands, grippers, neck")
TELEOP_GAIT = Topic("teleop/gait", GaitRequest, 0.0, 0.5, _EVENT, doc="gait requests")
TELEOP_DEVICE = Topic("teleop/device", DeviceInput, 20.0, 0.25, doc="headset and controllers")
TELEOP_STATUS = Topic("teleop/status", OperatorStatus, 5.0, 1.0, doc="progress of a script")
CAMERA_LEFT = Topic("camera/left", CameraFrame, 20.0, 0.5, priority=_B, doc="left eye")
CAMERA_RIGHT = Topic("camera/right", CameraFrame, 20.0, 0.5, priority=_B, doc="right eye")
HEALTH = Topic(
    "health", ServiceHealth, 2.0, 2.0, per_source=True, doc="loop timing and input health"
)
HEARTBEAT = Topic(
    "heartbeat", Heartbeat, 25.0, 0.1, priority=_C, per_source=True, doc="the loop is alive"
)
JOURNAL = Topic(
    "journal", StepJournal, 4.0, per_source=True, doc="what each step took in, for replay"
)
LINK_CHANGE = Topic(
    "link", LinkChange, 0.0, delivery=_EVENT, per_source=True, doc="injected delay in force"
)
TASK_STATUS = Topic("task/status", TaskStatus, 10.0, 0.5, doc="verdict of the task, at changes too")
TASK_SCENE = Topic("task/scene", SceneState, 50.0, 0.2, doc="where the task's objects are")
EPISODE = Topic("episode", EpisodeMark, 0.0, delivery=_EVENT, doc="start and end of episodes")

ALL_TOPICS: tuple[Topic[Message], ...] = (
    PLANT_STATE,
    PLANT_TRUTH,
    PLANT_STATUS,
    PLANT_REQUEST,
    ESTOP,
    WBC_COMMAND,
    WBC_STATE,
    WBC_REPLY,
    TELEOP_SETPOINT,
    TELEOP_GAIT,
    TELEOP_DEVICE,
    TELEOP_STATUS,
    CAMERA_LEFT,
    CAMERA_RIGHT,
    HEALTH,
    HEARTBEAT,
    JOURNAL,
    LINK_CHANGE,
    EPISODE,
    TASK_STATUS,
    TASK_SCENE,
)
"""Every topic there is."""


def topic_table() -> str:
    """The table as Markdown, for people."""
    rows = [
        "| topic | message | rate [Hz] | stale after [s] | read as | |",
        "|---|---|---|---|---|---|",
    ]
    for topic in ALL_TOPICS:
        key = f"{topic.name}/<source>" if topic.per_source else topic.name
        rate = f"{topic.rate:g}" if topic.rate else "event"
        stale = "" if topic.max_age == float("inf") else f"{topic.max_age:g}"
        rows.append(
            f"| `{key}` | {topic.schema.__name__} | {rate} | {stale} "
            f"| {topic.delivery.value} | {topic.doc} |"
        )
    return "\n".join(rows)


if __name__ == "__main__":
    print(topic_table())
