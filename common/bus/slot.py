"""One topic's place in an inbox: the queue of raw payloads, the last good value, the counters."""

import logging
import time
from collections import deque
from typing import Any, NamedTuple

from common.bus.codec import decode
from common.bus.delay import DelayLine
from common.bus.sequence import Arrival, SequenceTracker
from common.errors import SchemaError
from common.schemas import Message
from common.topics import Delivery, Topic

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


class Slot:
    """State of one input; see :class:`common.bus.inbox.Inbox` for the meaning of the counters."""

    def __init__(self, topic: Topic[Any], line: DelayLine[Raw] | None = None) -> None:
        """Create an empty slot, with a delay line in front if the link has a delay."""
        self.topic = topic
        self.line = line
        self.is_event = topic.delivery is Delivery.EVENT
        self.ready: deque[Raw] = deque()
        self._raw: deque[Raw] = deque() if line is not None else self.ready
        self._backlog = LATEST_BACKLOG
        if line is not None:
            self._backlog = LINK_BACKLOG
        elif self.is_event:
            self._backlog = EVENT_BACKLOG
        self.value: Message | None = None
        self.by_source: dict[str, Message] = {}
        self.events: list[Message] = []
        self.updated = False
        self.valid = False
        self.good_ns = 0
        self.arrival_ns = 0
        self.last_put_ns = self.seen_put_ns = -1
        self.received = self.refused = self.late = self.skipped = 0
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

    def put(self, payload: bytes, arrival_ns: int, tag: str | None) -> None:
        """Append a payload, letting the oldest go when too many wait (any one thread)."""
        raw = self._raw
        if len(raw) >= self._backlog:
            try:
                raw.popleft()
            except IndexError:  # the reader took them all just now
                pass
            else:
                self.skipped += 1
        raw.append(Raw(arrival_ns, payload, tag))
        if self.line is None:
            self.last_put_ns = arrival_ns

    def release(self, now_ns: int) -> bool:
        """Pass payloads through the delay line; whether any fell due by ``now_ns``."""
        line, raw = self.line, self._raw
        if line is None:
            return False
        while raw:
            item = raw.popleft()
            line.push(item, item.arrival_ns)
        if line.next_due_ns > now_ns:
            return False
        for due_ns, injected_ns, item in line.pop(now_ns):
            self.ready.append(Raw(due_ns, item.payload, item.tag, injected_ns))
            self.last_put_ns = due_ns
        return True

    def take(self) -> bool:
        """Decode everything that is ready; whether something became visible."""
        while self.ready:
            raw = self.ready.popleft()
            self.received += 1
            self.arrival_ns = raw.arrival_ns
            self._arrivals.append(raw.arrival_ns)
            try:
                message = decode(raw.payload, self.topic.schema, raw.tag, raw.injected_ns)
            except SchemaError as error:
                self._refuse(error)
            else:
                self._accept(message, raw.arrival_ns)
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

    def _accept(self, message: Message, arrival_ns: int) -> None:
        """Take in a good message, unless it repeats or (for a latest value) comes too late."""
        self.valid = True
        skipped = self.skipped
        if skipped != self._skipped_seen:
            self._sequence.excuse(skipped - self._skipped_seen)
            self._skipped_seen = skipped
        order = self._sequence.observe(message.header)
        if order is not Arrival.NEXT:
            self.late += 1
            if order is Arrival.REPEATED or not self.is_event:
                return
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
