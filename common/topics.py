"""THE table of topics: every key that is published is declared here and nowhere else.

Publishers, inboxes, health, the logger and the live table derive from it. A new topic needs a
schema in :mod:`common.schemas`, a row here, its name in :data:`ALL_TOPICS`, and an example message
in ``tests/common/transport/support.py``, from which codec tests and fuzzer take it.

Keys are ``<robot>/<topic name>``, for a topic with ``per_source``
``<robot>/<topic name>/<source>``. The keys of queries are in :mod:`common.queries`.
``python -m common.topics`` prints both tables.
"""

from dataclasses import dataclass
from enum import Enum
from typing import Generic, TypeVar

from common.ports import RUN_LIVE, Role
from common.schemas import (
    AuthorityState,
    CameraFrame,
    ControllerState,
    DeviceInput,
    EpisodeMark,
    Estop,
    EstopClear,
    GaitReply,
    GaitRequest,
    Heartbeat,
    JointCommand,
    LinkChange,
    Message,
    OperatorClaim,
    OperatorStatus,
    PlantRequest,
    PlantState,
    PlantStatus,
    PolicyState,
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

    Attributes:
        name: key without the robot and, for ``per_source``, without the source.
        schema: type of its messages.
        publishers: roles that publish it.
        readers: roles that act on it, besides :data:`LISTENERS`, which read every topic.
        rate: nominal [Hz]; 0 for events.
        max_age: age above which a reader calls the topic stale [s]; a message older than that on
            arrival (deliberately injected delay not counted) is not applied at all. Infinite for
            messages that must never be discarded.
        delivery: how it is read.
        priority: its urgency on the wire.
        per_source: every source publishes it under a key of its own.
        exclusive: there is one publisher at a time; a reader follows the first it hears until that
            is silent for ``max_age``, and refuses messages of any other.
        fleet: may be sent to many robots at once, by a put on a wildcard key such as ``*/estop``;
            a reader refuses such puts of other topics.
        doc: its content, for people.
    """

    name: str
    schema: type[M_co]
    publishers: tuple[Role, ...]
    readers: tuple[Role, ...]
    rate: float
    max_age: float = float("inf")
    delivery: Delivery = Delivery.LATEST
    priority: Priority = Priority.INTERACTIVE
    per_source: bool = False
    exclusive: bool = False
    fleet: bool = False
    doc: str = ""


LISTENERS = (Role.OBSERVER, Role.TOOL)
"""Roles that read every topic: loggers and monitors."""

_C, _B = Priority.CONTROL, Priority.BULK
_EVENT = Delivery.EVENT
_PLANT, _SENSOR, _TOOL = (Role.PLANT,), (Role.SENSOR,), (Role.TOOL,)
_WBC, _OPERATOR = (Role.CONTROLLER,), (Role.OPERATOR,)

# A row in two lines: what it is and who has it; how it travels.
# fmt: off
PLANT_STATE = Topic(
    "plant/state", PlantState, _PLANT, _WBC + _OPERATOR,
    200.0, 0.1, priority=_C, exclusive=True, doc="measured state",
)
PLANT_TRUTH = Topic(
    "plant/truth", PlantState, _PLANT, _SENSOR + _OPERATOR,
    50.0, 0.2, exclusive=True, doc="ground truth, for scoring and for policies without pictures",
)
PLANT_STATUS = Topic(
    "plant/status", PlantStatus, _PLANT, _OPERATOR,
    10.0, 0.5, exclusive=True, doc="guard, real-time factor, state age at torque",
)
PLANT_REQUEST = Topic(
    "plant/request", PlantRequest, _OPERATOR + _TOOL, _PLANT,
    0.0, 1.0, _EVENT, doc="reset, pause, resume, push",
)
ESTOP = Topic(
    "estop", Estop, _OPERATOR + _TOOL, _PLANT,
    0.0, delivery=_EVENT, priority=_C, fleet=True,
    doc="emergency stop button, latched by the plant",
)
ESTOP_CLEAR = Topic(
    "estop/clear", EstopClear, _OPERATOR + _TOOL, _PLANT,
    0.0, 1.0, _EVENT, priority=_C, doc="a person ends an emergency stop",
)
WBC_COMMAND = Topic(
    "wbc/command", JointCommand, _WBC, _PLANT,
    100.0, 0.1, priority=_C, doc="joint command",
)
WBC_STATE = Topic(
    "wbc/state", ControllerState, _WBC, _OPERATOR,
    100.0, 0.2, exclusive=True, doc="state machine, errors, solver",
)
WBC_REPLY = Topic(
    "wbc/reply", GaitReply, _WBC, _OPERATOR,
    0.0, delivery=_EVENT, doc="answers to gait requests",
)
WBC_AUTHORITY = Topic(
    "wbc/authority", AuthorityState, _WBC, _OPERATOR,
    10.0, 0.5, exclusive=True, doc="which operator has the robot, and why",
)
WBC_TARGET = Topic(
    "wbc/target", Setpoint, _WBC, _OPERATOR,
    20.0, 0.25, exclusive=True, doc="present target, from which a new holder starts",
)
TELEOP_CLAIM = Topic(
    "teleop/claim", OperatorClaim, _OPERATOR, _WBC,
    10.0, 1.0, doc="an operator wants the robot, has it, or releases it",
)
TELEOP_SETPOINT = Topic(
    "teleop/setpoint", Setpoint, _OPERATOR, _WBC,
    20.0, 0.25, doc="hands, grippers, neck",
)
TELEOP_GAIT = Topic(
    "teleop/gait", GaitRequest, _OPERATOR, _WBC,
    0.0, 0.5, _EVENT, doc="gait requests",
)
TELEOP_DEVICE = Topic(
    "teleop/device", DeviceInput, _OPERATOR, (),
    20.0, 0.25, doc="headset and controllers",
)
TELEOP_STATUS = Topic(
    "teleop/status", OperatorStatus, _OPERATOR, _OPERATOR,
    5.0, 1.0, doc="progress of a script",
)
POLICY_STATE = Topic(
    "policy/state", PolicyState, _OPERATOR, (),
    5.0, 1.0, doc="what a policy does, its delays, answers dropped",
)
CAMERA_LEFT = Topic(
    "camera/left", CameraFrame, _SENSOR, _OPERATOR,
    20.0, 0.5, priority=_B, exclusive=True, doc="left camera",
)
CAMERA_RIGHT = Topic(
    "camera/right", CameraFrame, _SENSOR, _OPERATOR,
    20.0, 0.5, priority=_B, exclusive=True, doc="right camera",
)
HEALTH = Topic(
    "health", ServiceHealth, (*RUN_LIVE, Role.OBSERVER), (),
    2.0, 2.0, per_source=True, doc="loop timing and input health",
)
HEARTBEAT = Topic(
    "heartbeat", Heartbeat, RUN_LIVE, RUN_LIVE,
    25.0, 0.1, priority=_C, per_source=True, doc="the loop is alive",
)
JOURNAL = Topic(
    "journal", StepJournal, RUN_LIVE, (),
    4.0, per_source=True, doc="what each step took in, for replay",
)
LINK_CHANGE = Topic(
    "link", LinkChange, RUN_LIVE, (),
    0.0, delivery=_EVENT, per_source=True, doc="injected delay in force",
)
TASK_STATUS = Topic(
    "task/status", TaskStatus, _PLANT, _OPERATOR,
    10.0, 0.5, exclusive=True, doc="verdict of the task, at changes too",
)
TASK_SCENE = Topic(
    "task/scene", SceneState, _PLANT, _SENSOR + _OPERATOR,
    50.0, 0.2, exclusive=True, doc="where the task's objects are",
)
EPISODE = Topic(
    "episode", EpisodeMark, _TOOL, (),
    0.0, delivery=_EVENT, doc="start and end of episodes",
)
# fmt: on

ALL_TOPICS: tuple[Topic[Message], ...] = (
    PLANT_STATE,
    PLANT_TRUTH,
    PLANT_STATUS,
    PLANT_REQUEST,
    ESTOP,
    ESTOP_CLEAR,
    WBC_COMMAND,
    WBC_STATE,
    WBC_REPLY,
    WBC_AUTHORITY,
    WBC_TARGET,
    TELEOP_CLAIM,
    TELEOP_SETPOINT,
    TELEOP_GAIT,
    TELEOP_DEVICE,
    TELEOP_STATUS,
    POLICY_STATE,
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
    """Format the table as Markdown."""
    rows = [
        "| topic | message | rate [Hz] | stale after [s] | read as | publishers | readers | |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for topic in ALL_TOPICS:
        key = f"{topic.name}/<source>" if topic.per_source else topic.name
        rate = f"{topic.rate:g}" if topic.rate else "event"
        stale = "" if topic.max_age == float("inf") else f"{topic.max_age:g}"
        rows.append(
            f"| `{key}` | {topic.schema.__name__} | {rate} | {stale} | {topic.delivery.value} "
            f"| {', '.join(topic.publishers)} | {', '.join(topic.readers)} | {topic.doc} |"
        )
    return "\n".join(rows)


if __name__ == "__main__":
    from common.program import run_program
    from common.queries import query_table

    def main() -> int:
        """Print both tables."""
        print(topic_table(), query_table(), sep="\n\n")
        return 0

    raise SystemExit(run_program("common.topics", main))
