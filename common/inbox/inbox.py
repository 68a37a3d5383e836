"""Give a service its inputs: fed from any thread, read once a step.

Where decoding happens. The transport's thread only appends payload and arrival time to a bounded
queue (a slow callback would hold up every other topic of the session, and would take the
interpreter lock from the control loop at any moment). The service's own thread decodes at the
start of its step, and decodes *every* waiting message, not just the newest of a latest-value
topic. That costs about ten microseconds for each message skipped over, and buys exactness:
sequence gaps and refusals are counted message by message, and when the newest payload is garbage
the value shown is the newest good one before it. Should a latest-value topic pile up more than
:data:`~common.inbox.arrivals.LATEST_BACKLOG` payloads (a service that stood still), the oldest are
dropped undecoded; they are counted as ``skipped`` and not as gaps, since the link did deliver them.

A link with a delay puts its :class:`~common.links.delay.DelayLine` between queue and decoding
(:meth:`common.inbox.arrivals.ArrivalQueue.release`). It too belongs to the service's thread: a
message's arrival is then its due time exactly, whenever the step comes that finds it, and no thread
of its own competes with the step.
"""

import threading
from collections.abc import Iterable, Mapping
from typing import Any, TypeVar, cast

from common.errors import TrillError
from common.inbox.arrivals import NEVER
from common.inbox.buffer import TopicBuffer
from common.inbox.context import InboxContext
from common.inbox.health import health_of
from common.links.config import CAMERAS, Links, link_seed
from common.links.delay import DelayLine, DelayStats
from common.links.spec import LinkSpec
from common.schemas import LinkHealth, Message, Sender
from common.topics import Topic

M = TypeVar("M", bound=Message)
_PAIRED_S = 1.0
"""Within it the messages of a pair arrive [s]."""


class Inbox:
    """Implements :class:`common.runtime.service.Inputs` from raw payloads.

    One thread may call :meth:`offer` per topic; everything else belongs to the service's thread.
    """

    def __init__(
        self,
        topics: Iterable[Topic[Any]],
        *,
        service: str = "",
        links: Links | None = None,
        seed: int = 0,
        trigger: Topic[Any] | None = None,
        context: InboxContext | None = None,
        max_age: Mapping[str, float] | None = None,
    ) -> None:
        """Create an empty inbox.

        Args:
            topics: what the service reads.
            service: its name, which chooses among ``links`` and seeds them.
            links: delays to inject.
            seed: the run's seed for links without their own.
            trigger: topic whose arrivals wake :meth:`wait`.
            context: clock offsets and journal; None: one clock, no journal.
            max_age: by topic name, how old a message may be on arrival to be applied, and how long
                it then stays fresh [s], where it differs from the table's.
        """
        links = links or Links()
        self._service, self._seed = service, seed
        self._journal = context.journal if context is not None else None
        self._buffers: dict[str, TopicBuffer] = {}
        for topic in topics:
            spec = links.of(service, topic.name)
            line = None if spec is None else self._line(topic, spec)
            age = (max_age or {}).get(topic.name)
            self._buffers[topic.name] = TopicBuffer(topic, line, context, age)
        self._all = tuple(self._buffers.values())
        self._linked = self._with_line()
        self._trigger = self._buffers[trigger.name] if trigger is not None else None
        self._trigger_seen_ns = -1
        self._asleep = threading.Lock()
        """Held until something wakes :meth:`wait`; an event takes twice as long."""
        self._asleep.acquire()
        self._updated: list[TopicBuffer] = []
        self._arrived = False
        """Whether anything was put, or fell due, that no step has looked at."""
        self._next_due_ns = 0 if self._linked else NEVER
        """When the next message that a step has looked at falls due [ns]; 0: not known."""
        self._now = 0

    def offer(
        self, topic_name: str, payload: bytes, arrival_ns: int, tag: str | None = None
    ) -> None:
        """Put in a payload; nothing is decoded here.

        Args:
            topic_name: one of the topics the inbox was made for.
            payload: the bytes received.
            arrival_ns: when, on the clock of :meth:`begin_step`.
            tag: schema tag given by the sender; None if it is known to be this version's.
        """
        buffer = self._buffers[topic_name]
        buffer.queue.put(payload, arrival_ns, tag)
        self._arrived = True
        if buffer is self._trigger:
            self.wake()

    def begin_step(self, now_ns: int) -> None:
        """Take in everything that arrived (or fell due) until ``now_ns``; a new snapshot."""
        self._now = now_ns
        if self._journal is not None:
            self._journal.begin_step(now_ns)
        if self._updated:
            for buffer in self._updated:
                buffer.end_step()
            self._updated.clear()
        arrived = self._arrived
        if arrived:
            # Cleared before looking: what arrives meanwhile sets it again for the next step.
            self._arrived = False
        if self._linked and (arrived or now_ns >= self._next_due_ns):
            arrived |= self._advance_links(now_ns)
        if arrived:
            for buffer in self._all:
                if buffer.queue.ready and buffer.take_in():
                    self._updated.append(buffer)

    def begin_replayed_step(self, now_ns: int, inputs: Iterable[tuple[str, Message, int]]) -> None:
        """Like :meth:`begin_step`, but show what the step took in when it was recorded.

        Args:
            now_ns: the step's time.
            inputs: topic name, message and time of arrival of each, in the order of the record.
        """
        self.begin_step(now_ns)
        for name, message, arrival_ns in inputs:
            buffer = self._buffers[name]
            buffer.show(message, arrival_ns)
            self._updated.append(buffer)

    def next_release_ns(self) -> int | None:
        """Return the time before which no step would be shown anything new [ns].

        It is that of the next message to fall due, or the arrival of one that no step has taken in
        or passed to its link yet. None: nothing waits.
        """
        due_ns = self._next_due_ns
        if self._arrived or not due_ns:
            due_ns = min(buffer.queue.next_release_ns for buffer in self._all)
        return None if due_ns == NEVER else due_ns

    def latest(self, topic: Topic[M]) -> M | None:
        """Last good message of a latest-value topic; None before the first."""
        return cast("M | None", self._buffer(topic).value)

    def latest_by_sender(self, topic: Topic[M]) -> dict[Sender, M]:
        """Last good message of a latest-value topic from each sender, most recent last."""
        return cast("dict[Sender, M]", dict(self._buffer(topic).by_sender))

    def history(self, topic: Topic[M], seconds: float) -> list[M]:
        """Good messages that arrived up to ``seconds`` before the newest, oldest first.

        They are kept from the first call on.
        """
        return cast("list[M]", self._buffer(topic).history(round(1e9 * seconds)))

    def latest_pair(self, left: Topic[M], right: Topic[M]) -> tuple[M, M] | None:
        """Newest messages of two topics with the same ``stamp``, such as stereo pictures.

        None if there are none within the last second; see :meth:`history`.
        """
        rights = {message.header.stamp: message for message in self.history(right, _PAIRED_S)}
        for message in reversed(self.history(left, _PAIRED_S)):
            if (other := rights.get(message.header.stamp)) is not None:
                return message, other
        return None

    def updated(self, topic: Topic[Any]) -> bool:
        """Whether a good message arrived since the previous step."""
        return self._buffer(topic).updated

    def fresh(self, topic: Topic[Any]) -> bool:
        """Whether the last good message arrived within the topic's largest age."""
        return self._buffer(topic).is_fresh(self._now)

    def age(self, topic: Topic[Any]) -> float:
        """Seconds since the last good message arrived (infinity before the first)."""
        return self._buffer(topic).age(self._now)

    def events(self, topic: Topic[M]) -> list[M]:
        """Messages of an event topic since the previous step, oldest first."""
        return cast("list[M]", list(self._buffer(topic).events))

    def health_of(self, topic: Topic[Any]) -> LinkHealth:
        """Health of one input as of the current step."""
        return self._health_of(self._buffer(topic))

    def link_health(self) -> list[LinkHealth]:
        """Health of every input, as published in :class:`~common.schemas.ServiceHealth`."""
        return [self._health_of(buffer) for buffer in self._all]

    def set_link(self, topic_name: str, spec: LinkSpec) -> None:
        """Change the link in front of an input from now on.

        Messages that are under way arrive as they would have. Service's thread only.
        """
        buffer = self._buffers[topic_name]
        # What has arrived already belongs to the old link, though no step has looked at it yet.
        buffer.release(-1)
        buffer.queue.set_line(self._line(buffer.topic, spec))
        self._linked = self._with_line()
        self._next_due_ns = 0

    def link_of(self, topic_name: str) -> str:
        """What is injected in front of an input, in words; empty: nothing."""
        spec = self.spec_of(topic_name)
        return "" if spec == LinkSpec() else str(spec)

    def spec_of(self, topic_name: str) -> LinkSpec:
        """What is injected in front of an input; all zero: nothing."""
        line = self._buffers[topic_name].queue.line
        return LinkSpec() if line is None else line.spec

    @property
    def stale(self) -> int:
        """Messages of all inputs that were too old when they arrived."""
        return sum(buffer.stale for buffer in self._all)

    @property
    def topics(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return tuple(self._buffers)

    def delay_stats(self) -> dict[str, DelayStats]:
        """Requested and achieved delay of every link that has one, by topic name."""
        lines = ((buffer.topic.name, buffer.queue.line) for buffer in self._linked)
        return {name: line.stats() for name, line in lines if line is not None}

    def wait(self, timeout_s: float) -> bool:
        """Sleep until a payload of the trigger topic arrives; False if time ran out.

        One that arrived since the last call, or since :meth:`trigger_arrival`, counts.
        """
        return self._asleep.acquire(timeout=max(0.0, timeout_s))

    def wake(self) -> None:
        """End a :meth:`wait` now, from any thread."""
        if self._asleep.locked():
            try:
                self._asleep.release()
            except RuntimeError:  # another thread was faster
                return

    def trigger_arrival(self, now_ns: int) -> int | None:
        """When the trigger topic last arrived or fell due, if since the last call; else None."""
        self._asleep.acquire(blocking=False)
        buffer = self._trigger
        if buffer is None:
            return None
        if buffer.queue.line is not None and self._advance_links(now_ns):
            self._arrived = True
        arrival = buffer.queue.last_put_ns
        if arrival == self._trigger_seen_ns:
            return None
        self._trigger_seen_ns = arrival
        return arrival

    @property
    def next_trigger_due_ns(self) -> int:
        """When the next delayed message of the trigger topic falls due [ns]."""
        return NEVER if self._trigger is None else self._trigger.queue.next_due_ns

    def _health_of(self, buffer: TopicBuffer) -> LinkHealth:
        link = self.link_of(buffer.topic.name) if buffer.queue.line is not None else ""
        return health_of(buffer, self._now, self._journal, link)

    def _line(self, topic: Topic[Any], spec: LinkSpec) -> DelayLine[Any]:
        seed = link_seed(self._seed, self._service, topic.name)
        return DelayLine(spec, seed, round(1e9 / topic.rate) if topic.name in CAMERAS else None)

    def _with_line(self) -> tuple[TopicBuffer, ...]:
        return tuple(buffer for buffer in self._all if buffer.queue.line is not None)

    def _advance_links(self, now_ns: int) -> bool:
        """Move payloads that arrived into the delay lines and those that fell due out of them.

        Returns whether any fell due.
        """
        any_due, next_due_ns = False, NEVER
        for buffer in self._linked:
            any_due |= buffer.release(now_ns)
            next_due_ns = min(next_due_ns, buffer.queue.next_due_ns)
        self._next_due_ns = next_due_ns
        return any_due

    def _buffer(self, topic: Topic[Any]) -> TopicBuffer:
        buffer = self._buffers.get(topic.name)
        if buffer is None:
            raise TrillError(
                f"topic {topic.name!r} is not among this service's inputs "
                f"({', '.join(self._buffers) or 'none'}); add it to the service's `reads`"
            )
        return buffer
