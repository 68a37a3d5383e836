"""Count the traffic of the bus and take snapshots of it for the live table. Pure.

Every message is only counted when it arrives. The few that the table quotes are decoded when a
snapshot is taken, so that watching costs little beside the system being watched.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from math import inf
from typing import Any, TypeVar

from common.errors import SchemaError
from common.schemas import (
    AuthorityState,
    ControllerState,
    LinkHealth,
    Message,
    OperatorStatus,
    PeerHealth,
    PlantStatus,
    PolicyState,
    ServiceHealth,
    TaskStatus,
)
from common.topics import (
    ALL_TOPICS,
    HEALTH,
    HEARTBEAT,
    PLANT_STATUS,
    POLICY_STATE,
    TASK_STATUS,
    TELEOP_STATUS,
    WBC_AUTHORITY,
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
"""Rates are averaged over this time [s]."""
HEALTH_TIMEOUT = 3.0
"""A service without a heartbeat is dead when its health was not heard for this long [s]."""
HEARTBEAT_TIMEOUTS = 3.0
"""Number of its own timeouts after which a service with a heartbeat is shown as dead.

The monitor has no real-time scheduling, so it is more patient than the service's peers.
"""

M = TypeVar("M", bound=Message)


@dataclass(frozen=True)
class TopicRow:
    """One topic; ``too_old`` and ``refused`` are the sums of what its readers report.

    ``rate`` and ``nominal`` are in Hz, ``age`` of the last message is in seconds.
    """

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
    def has_problems(self) -> bool:
        """Whether it is stale or anything was lost, late, repeated or refused."""
        counts = (self.gaps, self.late, self.repeated, self.too_old, self.refused)
        return self.stale or any(counts)


@dataclass(frozen=True)
class ServiceRow:
    """One service, from its last health message and its heartbeat.

    Attributes:
        health: the last health message.
        health_age: time since it was received [s].
        heartbeat_age: time since the last heartbeat [s]; None for a service without one.
        timeout: silence of its heartbeat after which its peers take it for dead [s].
    """

    health: ServiceHealth
    health_age: float
    heartbeat_age: float | None = None
    timeout: float = 0.0

    @property
    def silence(self) -> float:
        """Time since its last heartbeat, or else its last health message [s]."""
        return self.health_age if self.heartbeat_age is None else self.heartbeat_age

    @property
    def alive(self) -> bool:
        """Whether its silence has not lasted too long."""
        if self.heartbeat_age is None:
            return self.silence <= HEALTH_TIMEOUT
        return self.silence <= HEARTBEAT_TIMEOUTS * self.timeout

    @property
    def put_errors(self) -> int:
        """Messages of it that the transport refused to send."""
        return sum(output.errors for output in self.health.outputs)


@dataclass(frozen=True)
class InputRow:
    """One input of a service that is alive."""

    consumer: str
    health: LinkHealth


@dataclass(frozen=True)
class PeerRow:
    """One service as the service ``seen_by`` sees it."""

    seen_by: str
    peer: PeerHealth

    @property
    def dead(self) -> bool:
        """Whether it is missed by ``seen_by``, which had heard it before."""
        return not self.peer.alive and self.peer.silent >= 0.0

    @property
    def is_notable(self) -> bool:
        """Whether it is dead, or has another clock or an unknown one."""
        return self.dead or self.peer.clock_error != 0.0


@dataclass(frozen=True)
class Snapshot:
    """Everything the live table shows at one moment."""

    topics: tuple[TopicRow, ...]
    services: tuple[ServiceRow, ...]
    control: ControllerState | None = None
    plant: PlantStatus | None = None
    operator: OperatorStatus | None = None
    task: TaskStatus | None = None
    authority: AuthorityState | None = None
    policy: PolicyState | None = None

    @property
    def inputs(self) -> tuple[InputRow, ...]:
        """Inputs of all services that are alive."""
        return tuple(
            InputRow(service.health.service, link)
            for service in self.services
            if service.alive
            for link in service.health.links
        )

    @property
    def ledger(self) -> tuple[InputRow, ...]:
        """Inputs that received something during the last seconds."""
        return tuple(row for row in self.inputs if row.health.stages)

    @property
    def links(self) -> tuple[InputRow, ...]:
        """Inputs with an injected delay."""
        return tuple(row for row in self.inputs if row.health.link)

    @property
    def peers(self) -> tuple[PeerRow, ...]:
        """Services that another one misses, or whose clock differs from its own."""
        rows = (
            PeerRow(service.health.service, peer)
            for service in self.services
            if service.alive
            for peer in service.health.peers
        )
        return tuple(row for row in rows if row.is_notable)


@dataclass
class _KeyStats:
    """Messages of one key."""

    messages: int = 0
    sequence: SequenceTracker = field(default_factory=SequenceTracker)
    arrivals: deque[int] = field(default_factory=deque)
    last: RawSample | None = None

    def add(self, sample: RawSample) -> None:
        self.messages += 1
        self.last = sample
        self.arrivals.append(sample.arrival_ns)
        while self.arrivals[0] < sample.arrival_ns - WINDOW * 1e9:
            self.arrivals.popleft()
        header = wire_header(sample.payload)
        if header is not None:
            self.sequence.observe(header)

    def age(self, now_ns: int) -> float:
        """Return the time since the last arrival [s]."""
        return inf if self.last is None else (now_ns - self.last.arrival_ns) * 1e-9

    def recent(self, now_ns: int) -> int:
        """Count the arrivals within :data:`WINDOW`."""
        return sum(arrival > now_ns - WINDOW * 1e9 for arrival in self.arrivals)

    def decoded(self, topic: Topic[M]) -> M | None:
        """Decode the last message; None if there is none, or none that can be decoded."""
        if self.last is None:
            return None
        try:
            return decode(self.last.payload, topic.schema, self.last.tag or None)
        except SchemaError:
            return None  # The readers of the topic refuse it too, and count it.


class BusStats:
    """Counts the samples of a bus tap by key."""

    def __init__(self, robot: str) -> None:
        """Start empty; ``robot`` is the first part of every key."""
        self._robot = robot
        self._topics: dict[str, dict[str, _KeyStats]] = {}

    def add(self, samples: Iterable[RawSample]) -> None:
        """Count samples, oldest first; keys outside the table of topics are ignored."""
        for sample in samples:
            topic = topic_of(self._robot, sample.key)
            if topic is not None:
                keys = self._topics.setdefault(topic.name, {})
                keys.setdefault(sample.key, _KeyStats()).add(sample)

    def snapshot(self, now_ns: int) -> Snapshot:
        """Return what the table shows at the monotonic time ``now_ns``."""
        services = tuple(
            self._service(health, stats.age(now_ns), now_ns)
            for _, stats in sorted(self._topics.get(HEALTH.name, {}).items())
            if (health := stats.decoded(HEALTH)) is not None
        )
        return Snapshot(
            topics=tuple(
                _topic_row(topic, list(self._topics[topic.name].values()), services, now_ns)
                for topic in ALL_TOPICS
                if topic.name in self._topics
            ),
            services=services,
            control=self.latest(WBC_STATE),
            plant=self.latest(PLANT_STATUS),
            operator=self.latest(TELEOP_STATUS),
            task=self.latest(TASK_STATUS),
            authority=self.latest(WBC_AUTHORITY),
            policy=self.latest(POLICY_STATE),
        )

    def _service(self, health: ServiceHealth, age: float, now_ns: int) -> ServiceRow:
        key = key_of(self._robot, HEARTBEAT, health.service)
        stats = self._topics.get(HEARTBEAT.name, {}).get(key, _KeyStats())
        beat = stats.decoded(HEARTBEAT)
        if beat is None:
            return ServiceRow(health, age)
        return ServiceRow(health, age, stats.age(now_ns), beat.timeout)

    def latest(self, topic: Topic[M]) -> M | None:
        """Return the last message of a topic with one source; None before the first."""
        keys = list(self._topics.get(topic.name, {}).values())
        return keys[-1].decoded(topic) if keys else None


def _topic_row(
    topic: Topic[Any], keys: list[_KeyStats], services: tuple[ServiceRow, ...], now_ns: int
) -> TopicRow:
    age = min(stats.age(now_ns) for stats in keys)
    links = [
        link for service in services for link in service.health.links if link.topic == topic.name
    ]
    return TopicRow(
        name=topic.name,
        rate=sum(stats.recent(now_ns) for stats in keys) / WINDOW,
        nominal=topic.rate * len(keys),
        age=age,
        messages=sum(stats.messages for stats in keys),
        gaps=sum(stats.sequence.missing for stats in keys),
        late=sum(stats.sequence.late for stats in keys),
        repeated=sum(stats.sequence.repeated for stats in keys),
        stale=topic.delivery is Delivery.LATEST and age > topic.max_age,
        too_old=sum(link.stale for link in links),
        refused=sum(link.refused + link.foreign for link in links),
    )
