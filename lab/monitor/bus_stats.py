"""What the live table shows, gathered from everything on the bus. Pure.

Every message is only counted as it arrives; the few that the table quotes are decoded when the
table is drawn, so that watching costs little beside the system being watched.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from math import inf
from typing import Any, TypeVar

from common.errors import SchemaError
from common.schemas import (
    ControllerState,
    LinkHealth,
    Message,
    OperatorStatus,
    PeerHealth,
    PlantStatus,
    ServiceHealth,
    TaskStatus,
)
from common.topics import (
    ALL_TOPICS,
    HEALTH,
    HEARTBEAT,
    PLANT_STATUS,
    TASK_STATUS,
    TELEOP_STATUS,
    WBC_STATE,
    Delivery,
    Topic,
)
from common.transport.keys import key_of, topic_of
from common.transport.tap import RawSample
from common.wire.codec import decode
from common.wire.header import wire_header
from common.wire.sequence import SequenceTracker

WINDOW = 2.0
"""Rates are over this long [s]."""
DEAD_AFTER = 3.0
"""A service without a heartbeat whose health was not heard for this long is called silent [s]."""
PATIENCE = 3.0
"""Promises of silence after which one with a heartbeat is; the table is no real-time watcher."""

M = TypeVar("M", bound=Message)


@dataclass(frozen=True)
class TopicRow:
    """One topic as the monitor sees it; the last two are the sums of what its readers report."""

    name: str
    rate: float
    nominal: float
    age: float
    messages: int
    gaps: int
    late: int
    repeated: int
    stale: bool
    too_old: int
    refused: int

    @property
    def troubled(self) -> bool:
        """Whether there is something to see."""
        counts = (self.gaps, self.late, self.repeated, self.too_old, self.refused)
        return self.stale or any(counts)


@dataclass(frozen=True)
class ServiceRow:
    """One service, from its last health message and its heartbeat."""

    health: ServiceHealth
    age: float
    """Since its health was heard [s]."""
    beat: float | None = None
    """Since its heartbeat was heard [s]; None: it has none."""
    promise: float = 0.0
    """Silence of it that means death [s]."""

    @property
    def silent(self) -> float:
        """Since its last sign of life [s]."""
        return self.age if self.beat is None else self.beat

    @property
    def alive(self) -> bool:
        """Whether it gave a sign of life lately."""
        patience = DEAD_AFTER if self.beat is None else PATIENCE * self.promise
        return self.silent <= patience

    @property
    def put_errors(self) -> int:
        """Messages the transport refused to take from it."""
        return sum(output.errors for output in self.health.outputs)


@dataclass(frozen=True)
class InputRow:
    """One input of a service that lives."""

    consumer: str
    health: LinkHealth


@dataclass(frozen=True)
class PeerRow:
    """One service as another one sees it."""

    seen_by: str
    peer: PeerHealth

    @property
    def notable(self) -> bool:
        """Whether it is gone, or goes by another clock or one that is not known."""
        gone = not self.peer.alive and self.peer.silent >= 0.0
        return gone or self.peer.clock_error != 0.0


@dataclass(frozen=True)
class Snapshot:
    """Everything the table shows at one moment."""

    topics: tuple[TopicRow, ...]
    services: tuple[ServiceRow, ...]
    control: ControllerState | None = None
    plant: PlantStatus | None = None
    operator: OperatorStatus | None = None
    task: TaskStatus | None = None

    @property
    def inputs(self) -> tuple[InputRow, ...]:
        """Inputs of all services that are alive."""
        alive = (service for service in self.services if service.alive)
        return tuple(
            InputRow(service.health.service, link)
            for service in alive
            for link in service.health.links
        )

    @property
    def ledger(self) -> tuple[InputRow, ...]:
        """Those that took in something during the last seconds."""
        return tuple(row for row in self.inputs if row.health.stages)

    @property
    def links(self) -> tuple[InputRow, ...]:
        """Those in front of which a delay is injected."""
        return tuple(row for row in self.inputs if row.health.link)

    @property
    def peers(self) -> tuple[PeerRow, ...]:
        """What is notable about others' life and clocks."""
        rows = (
            PeerRow(service.health.service, peer)
            for service in self.services
            if service.alive
            for peer in service.health.peers
        )
        return tuple(row for row in rows if row.notable)


@dataclass
class _Account:
    """What one key did."""

    messages: int = 0
    sequence: SequenceTracker = field(default_factory=SequenceTracker)
    arrivals: deque[int] = field(default_factory=deque)
    last: RawSample | None = None

    def age(self, now_ns: int) -> float:
        """Seconds since the last arrival."""
        return inf if self.last is None else (now_ns - self.last.arrival_ns) * 1e-9

    def recent(self, now_ns: int) -> int:
        """Arrivals within the window."""
        return sum(arrival > now_ns - WINDOW * 1e9 for arrival in self.arrivals)


class BusStats:
    """Counts what a tap drained, by key."""

    def __init__(self, robot: str) -> None:
        """Start empty; ``robot`` is the first part of every key."""
        self._robot = robot
        self._accounts: dict[str, dict[str, _Account]] = {}

    def note(self, samples: Iterable[RawSample]) -> None:
        """Count samples, oldest first; keys outside the topic table are none of the table's."""
        for sample in samples:
            topic = topic_of(self._robot, sample.key)
            if topic is None:
                continue
            account = self._accounts.setdefault(topic.name, {}).setdefault(sample.key, _Account())
            account.messages += 1
            account.last = sample
            account.arrivals.append(sample.arrival_ns)
            while account.arrivals[0] < sample.arrival_ns - WINDOW * 1e9:
                account.arrivals.popleft()
            header = wire_header(sample.payload)
            if header is not None:
                account.sequence.observe(header)

    def view(self, now_ns: int) -> Snapshot:
        """What there is to show at monotonic time ``now_ns``."""
        services = tuple(
            self._service(health, account.age(now_ns), now_ns)
            for _, account in sorted(self._accounts.get(HEALTH.name, {}).items())
            if (health := _decoded(HEALTH, account)) is not None
        )
        return Snapshot(
            topics=tuple(
                _row(topic, list(self._accounts[topic.name].values()), services, now_ns)
                for topic in ALL_TOPICS
                if topic.name in self._accounts
            ),
            services=services,
            control=self.latest(WBC_STATE),
            plant=self.latest(PLANT_STATUS),
            operator=self.latest(TELEOP_STATUS),
            task=self.latest(TASK_STATUS),
        )

    def _service(self, health: ServiceHealth, age: float, now_ns: int) -> ServiceRow:
        key = key_of(self._robot, HEARTBEAT, health.service)
        account = self._accounts.get(HEARTBEAT.name, {}).get(key)
        beat = None if account is None else _decoded(HEARTBEAT, account)
        if account is None or beat is None:
            return ServiceRow(health, age)
        return ServiceRow(health, age, account.age(now_ns), beat.promise)

    def latest(self, topic: Topic[M]) -> M | None:
        """Last message of a topic with one source; None before the first good one."""
        accounts = list(self._accounts.get(topic.name, {}).values())
        return _decoded(topic, accounts[-1]) if accounts else None


def _decoded(topic: Topic[M], account: _Account) -> M | None:
    if account.last is None:
        return None
    try:
        return decode(account.last.payload, topic.schema, account.last.tag or None)
    except SchemaError:
        return None  # the topic's readers refuse it too, and count it


def _row(
    topic: Topic[Any], own: list[_Account], services: tuple[ServiceRow, ...], now_ns: int
) -> TopicRow:
    age = min(account.age(now_ns) for account in own)
    read = [
        link for service in services for link in service.health.links if link.topic == topic.name
    ]
    return TopicRow(
        name=topic.name,
        rate=sum(account.recent(now_ns) for account in own) / WINDOW,
        nominal=topic.rate * len(own),
        age=age,
        messages=sum(account.messages for account in own),
        gaps=sum(account.sequence.missing for account in own),
        late=sum(account.sequence.late for account in own),
        repeated=sum(account.sequence.repeated for account in own),
        stale=topic.delivery is Delivery.LATEST and age > topic.max_age,
        too_old=sum(link.stale for link in read),
        refused=sum(link.refused for link in read),
    )
