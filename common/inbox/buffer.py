"""One topic's place in an inbox: the queue of raw payloads, the last good value, the counters."""

import logging
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

from common.errors import SchemaError
from common.journal.journal import UNKNOWN, Journal, Take
from common.links.delay import DelayLine
from common.schemas import Header, Message
from common.topics import Delivery, Topic
from common.wire.codec import decode
from common.wire.header import wire_header
from common.wire.sequence import Arrival, SequenceTracker

LATEST_BACKLOG = 32
"""Raw payloads of a latest-value topic kept for a service that does not come to read."""
EVENT_BACKLOG = 256
"""The same for an event topic."""
LINK_BACKLOG = 4096
"""The same in front of a delay line, which must see every arrival."""
NEVER = 2**63
"""A time out of reach [ns]."""

_RATE_WINDOW_NS = 1_000_000_000
_RATE_KEPT = 4096
_MAX_SOURCES = 64
_LOG_INTERVAL_S = 1.0
_MAX_REFUSAL = 400

_log = logging.getLogger(__name__)


class Raw(NamedTuple):
    """A payload as it arrived (or fell due)."""

    arrival_ns: int
    payload: bytes
    tag: str | None
    injected_ns: int = 0


def _oldest(queue: deque[Raw]) -> Raw | None:
    """Take out the oldest; None if the other thread took the last just now."""
    try:
        return queue.popleft()
    except IndexError:
        return None


def _same_clock(_header: Header) -> int:
    return 0


@dataclass(frozen=True)
class InboxContext:
    """What the slots of an inbox share.

    Attributes:
        offset_of: this clock minus that of the sender of a message [ns]; :data:`UNKNOWN` if not
            known.
        clock: to time the decoding with [ns]; None: not timed.
        journal: where everything taken in is noted.
    """

    offset_of: Callable[[Header], int] = _same_clock
    clock: Callable[[], int] | None = None
    journal: Journal | None = None


class TopicBuffer:
    """State of one input; see :class:`common.inbox.inbox.Inbox` for the meaning of the counters."""

    def __init__(
        self,
        topic: Topic[Any],
        line: DelayLine[Raw] | None = None,
        tools: InboxContext | None = None,
        max_age: float | None = None,
    ) -> None:
        """Create an empty slot.

        Args:
            topic: what it takes in.
            line: delays it first.
            tools: clock offsets and journal.
            max_age: what is older on arrival is not applied [s]; None: the topic's own.
        """
        self.topic = topic
        self._tools = tools or InboxContext()
        age = topic.max_age if max_age is None else max_age
        self._oldest_ns = round(1e9 * age) if age < 1e9 else NEVER
        self.is_event = topic.delivery is Delivery.EVENT
        self.ready: deque[Raw] = deque()
        self._raw = self.ready
        self._backlog = EVENT_BACKLOG if self.is_event else LATEST_BACKLOG
        self.line: DelayLine[Raw] | None = None
        if line is not None:
            self.set_line(line)
        self.value: Message | None = None
        self.by_source: dict[str, Message] = {}
        self.events: list[Message] = []
        self.updated = False
        self.valid = False
        self.good_ns = 0
        self.arrival_ns = 0
        self.last_put_ns = self.seen_put_ns = -1
        self.received = self.refused = self.late = self.repeated = self.skipped = self.stale = 0
        self.last_refusal = ""
        self._sequence = SequenceTracker()
        self._skipped_seen = 0
        self._arrivals: deque[int] = deque(maxlen=_RATE_KEPT)
        self._logged_at = -_LOG_INTERVAL_S

    @property
    def gaps(self) -> int:
        """Messages missing by sequence number, so far."""
        return self._sequence.missing

    @property
    def restarts(self) -> int:
        """Times a publisher unknown so far appeared after the first."""
        return max(0, self._sequence.streams_seen - 1)

    def set_line(self, line: DelayLine[Raw]) -> None:
        """Put another delay line in front; a slot that had one keeps one, if of no delay.

        What the old one still holds falls due as it would have: a change loses nothing.
        """
        if self.line is not None:
            line.adopt(self.line)
        self.line = line
        if self._raw is self.ready:
            self._raw = deque()
        self._backlog = LINK_BACKLOG

    def put(self, payload: bytes, arrival_ns: int, tag: str | None) -> None:
        """Append a payload, letting the oldest go when too many wait (any one thread)."""
        raw = self._raw
        if len(raw) >= self._backlog:
            self.skipped += _oldest(raw) is not None
        raw.append(Raw(arrival_ns, payload, tag))
        if self.line is None:
            self.last_put_ns = arrival_ns

    def release(self, now_ns: int) -> bool:
        """Pass payloads through the delay line; whether any fell due by ``now_ns``."""
        line, raw = self.line, self._raw
        if line is None:
            return False
        # As many as wait now: more may come faster than they are taken.
        for _ in range(len(raw)):
            item = _oldest(raw)
            if item is None:
                break
            stamp = None
            if line.by_time and (head := wire_header(item.payload)) is not None:
                stamp = head.stamp or None
            if not line.push(item, item.arrival_ns, stamp) and self._tools.journal is not None:
                lost = item._replace(injected_ns=-1, arrival_ns=item.arrival_ns - 1)
                header = wire_header(item.payload)
                self._note(self._tools.journal, Take.LOST, header, lost, UNKNOWN, 0)
        if line.next_due_ns > now_ns:
            return False
        for due_ns, injected_ns, item in line.pop(now_ns):
            self.ready.append(Raw(due_ns, item.payload, item.tag, injected_ns))
            self.last_put_ns = due_ns
        return True

    def take(self) -> bool:
        """Decode everything that is ready now; whether something became visible.

        What comes meanwhile is left for the next step, lest a flood keep this one from ending.
        """
        for _ in range(len(self.ready)):
            raw = _oldest(self.ready)
            if raw is None:
                break
            self.received += 1
            self.arrival_ns = raw.arrival_ns
            self._arrivals.append(raw.arrival_ns)
            self._take(raw)
        return self.updated

    def end_step(self) -> None:
        """Forget what was new in the step that ended."""
        self.updated = False
        if self.events:
            self.events = []

    def rate(self, now_ns: int) -> float:
        """Arrivals per second over the last second."""
        arrivals = self._arrivals
        start = now_ns - _RATE_WINDOW_NS
        while arrivals and arrivals[0] <= start:
            arrivals.popleft()
        return len(arrivals) * 1e9 / _RATE_WINDOW_NS

    def _take(self, raw: Raw) -> None:
        """Decode one message, decide about it and note it."""
        clock, journal = self._tools.clock, self._tools.journal
        started = clock() if clock else 0
        try:
            message = decode(raw.payload, self.topic.schema, raw.tag, raw.injected_ns)
        except SchemaError as error:
            self._refuse(error)
            if journal is not None:
                self._note(journal, Take.REFUSED, wire_header(raw.payload), raw, UNKNOWN, 0)
            return
        header = message.header
        offset = self._tools.offset_of(header)
        transit = raw.arrival_ns - raw.injected_ns - header.sent - offset
        if offset != UNKNOWN and header.sent and transit > self._oldest_ns:
            self.stale += 1
            self._observe(header)
            kind = Take.STALE
        else:
            kind = self._accept(message, raw.arrival_ns)
        if journal is not None:
            self._note(journal, kind, header, raw, offset, clock() - started if clock else 0)

    def _note(
        self,
        journal: Journal,
        kind: Take,
        header: Header | None,
        raw: Raw,
        offset: int,
        decode_ns: int,
    ) -> None:
        times = (raw.arrival_ns - raw.injected_ns, raw.injected_ns, offset, decode_ns)
        journal.take(self.topic.name, kind, header, raw.payload, times)

    def _accept(self, message: Message, arrival_ns: int) -> Take:
        """Take in a good message, unless it repeats or (for a latest value) comes too late."""
        self.valid = True
        order = self._observe(message.header)
        if order is Arrival.WILD:
            self._refuse(
                SchemaError(f"sequence number {message.header.seq} is far beyond the last")
            )
            return Take.REFUSED
        if order is Arrival.REPEATED:
            self.repeated += 1
            return Take.LATE
        if order is Arrival.LATE:
            self.late += 1
            if not self.is_event:
                return Take.LATE
        self.show(message, arrival_ns)
        return Take.APPLIED

    def _observe(self, header: Header) -> Arrival:
        """Account for a message's number; what was skipped before it is not missing."""
        skipped = self.skipped
        if skipped != self._skipped_seen:
            self._sequence.excuse(skipped - self._skipped_seen)
            self._skipped_seen = skipped
        return self._sequence.observe(header)

    def show(self, message: Message, arrival_ns: int) -> None:
        """Let the service see a good message; a replay comes here directly."""
        self.value = message
        self.good_ns = arrival_ns
        self.updated = True
        if self.is_event:
            self.events.append(message)
        elif self.topic.per_source:
            source = message.header.source
            if source in self.by_source or len(self.by_source) < _MAX_SOURCES:
                self.by_source[source] = message

    def _refuse(self, error: SchemaError) -> None:
        """Count a bad message; the last good value stands."""
        self.valid = False
        self.refused += 1
        self._sequence.excuse(1)
        self.last_refusal = str(error)[:_MAX_REFUSAL]
        now = time.monotonic()
        if now - self._logged_at >= _LOG_INTERVAL_S:
            self._logged_at = now
            _log.warning("refused %s (%d so far): %s", self.topic.name, self.refused, error)
