"""Hold one input of a service: payloads that wait, the last good value, counters."""

import logging
import time
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import Any

from common.errors import SchemaError
from common.inbox.arrivals import ArrivalQueue, RawMessage
from common.journal.journal import Journal
from common.journal.tables import UNKNOWN, InputOutcome, InputTimes
from common.links.delay import DelayLine
from common.schemas import Header, Message, Sender
from common.topics import Delivery, Topic
from common.wire.codec import decode, schema_tag
from common.wire.header import wire_header
from common.wire.sequence import MessageOrder, SequenceTracker

_NEVER = 2**63
_RATE_WINDOW_NS = 1_000_000_000
_RATE_KEPT = 4096
_MAX_SENDERS = 64
_LOG_INTERVAL_S = 1.0
_MAX_REFUSAL = 400

_log = logging.getLogger(__name__)


def _same_clock(_header: Header) -> int:
    return 0


@dataclass(frozen=True)
class InboxContext:
    """What the buffers of an inbox share.

    Attributes:
        offset_of: returns this clock minus that of the sender of a message [ns]; :data:`UNKNOWN`
            if not known.
        clock: to time the decoding with [ns]; None: not timed.
        journal: records every message that is taken in.
    """

    offset_of: Callable[[Header], int] = _same_clock
    clock: Callable[[], int] | None = None
    journal: Journal | None = None


class TopicBuffer:
    """State of one input; see :mod:`common.inbox.inbox` for what happens in which thread.

    Attributes:
        topic: what it takes in.
        is_event: whether each message matters, not only the newest.
        queue: payloads that wait.
        value: the last good message; None before the first.
        by_sender: the last good message of each sender, for a latest-value topic.
        events: good messages of the current step, for an event topic.
        updated: whether a good message became visible in the current step.
        good_ns: arrival of the last good message [ns].
        received: messages decoded or refused.
        refused, late, repeated, stale, adapted: as in :class:`~common.schemas.LinkHealth`.
        last_refusal: why the last refused message was refused.
    """

    def __init__(
        self,
        topic: Topic[Any],
        line: DelayLine[RawMessage] | None = None,
        context: InboxContext | None = None,
        max_age: float | None = None,
    ) -> None:
        """Create an empty buffer.

        Args:
            topic: what it takes in.
            line: delays arrivals.
            context: clock offsets and journal.
            max_age: messages older than this on arrival are not applied [s]; None: the topic's own.
        """
        self.topic = topic
        self._context = context or InboxContext()
        age = topic.max_age if max_age is None else max_age
        self._max_age_ns = round(1e9 * age) if age < 1e9 else _NEVER
        self.is_event = topic.delivery is Delivery.EVENT
        schema: type[Message] = topic.schema
        self._tag = schema_tag(schema)
        self.queue = ArrivalQueue(is_event=self.is_event)
        if line is not None:
            self.queue.set_line(line)
        self.value: Message | None = None
        self.by_sender: OrderedDict[Sender, Message] = OrderedDict()
        self.events: list[Message] = []
        self.updated = False
        self.good_ns = 0
        self.received = self.refused = self.late = self.repeated = self.stale = self.adapted = 0
        self.last_refusal = ""
        self._sequence = SequenceTracker()
        self._skipped_seen = 0
        self._arrivals: deque[int] = deque(maxlen=_RATE_KEPT)
        self._logged_at = -_LOG_INTERVAL_S

    @property
    def gaps(self) -> int:
        """Messages missing by sequence number, so far."""
        return self._sequence.missing

    def age(self, now_ns: int) -> float:
        """Seconds since the last good message arrived; infinity before the first."""
        return 1e-9 * (now_ns - self.good_ns) if self.value is not None else inf

    def is_fresh(self, now_ns: int) -> bool:
        """Whether the last good message arrived within the topic's ``max_age``."""
        return self.value is not None and self.age(now_ns) <= self.topic.max_age

    def release(self, now_ns: int) -> bool:
        """Pass payloads through the link, if any; returns whether any fell due by ``now_ns``."""
        return self.queue.release(now_ns, self._record_lost)

    def take_in(self) -> bool:
        """Decode all messages that are ready; returns whether one became visible.

        Messages that arrive meanwhile are left for the next step, so that a flood cannot keep this
        one from ending.
        """
        for _ in range(len(self.queue)):
            raw = self.queue.pop()
            if raw is None:
                break
            self.received += 1
            self._arrivals.append(raw.arrival_ns)
            self._process(raw)
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

    def show(self, message: Message, arrival_ns: int) -> None:
        """Make a good message visible to the service; a replay calls this directly."""
        self.value = message
        self.good_ns = arrival_ns
        self.updated = True
        if self.is_event:
            self.events.append(message)
            return
        sender = message.header.sender
        self.by_sender[sender] = message
        self.by_sender.move_to_end(sender)
        if len(self.by_sender) > _MAX_SENDERS:
            self.by_sender.popitem(last=False)

    def _process(self, raw: RawMessage) -> None:
        """Decode one message, decide about it and record it."""
        clock = self._context.clock
        started = clock() if clock else 0
        try:
            message = decode(raw.payload, self.topic.schema, raw.tag, raw.injected_ns)
        except SchemaError as error:
            self._refuse(error)
            head = wire_header(raw.payload)
            self._record(InputOutcome.REFUSED, head, raw, _times(raw, UNKNOWN, 0))
            return
        self.adapted += raw.tag is not None and raw.tag != self._tag
        header = message.header
        offset = self._context.offset_of(header)
        transit = raw.arrival_ns - raw.injected_ns - header.sent - offset
        if offset != UNKNOWN and header.sent and transit > self._max_age_ns:
            self.stale += 1
            self._observe(header)
            outcome = InputOutcome.STALE
        else:
            outcome = self._accept(message, raw.arrival_ns)
        decode_ns = clock() - started if clock else 0
        self._record(outcome, header, raw, _times(raw, offset, decode_ns))

    def _record_lost(self, raw: RawMessage) -> None:
        """Record a message that the link dropped on purpose."""
        if self._context.journal is not None:
            times = InputTimes(raw.arrival_ns, injected=-1, offset=UNKNOWN, decode=0)
            self._record(InputOutcome.LOST, wire_header(raw.payload), raw, times)

    def _record(
        self, outcome: InputOutcome, header: Header | None, raw: RawMessage, times: InputTimes
    ) -> None:
        """Write an input record to the journal, if there is one."""
        journal = self._context.journal
        if journal is not None:
            tag = self._tag if raw.tag is None else raw.tag
            journal.record(self.topic.name, outcome, header, raw.payload, tag, times)

    def _accept(self, message: Message, arrival_ns: int) -> InputOutcome:
        """Show a good message, unless it repeats or (for a latest value) was overtaken."""
        order = self._observe(message.header)
        if order is MessageOrder.IMPLAUSIBLE:
            self._refuse(
                SchemaError(f"sequence number {message.header.seq} is far beyond the last")
            )
            return InputOutcome.REFUSED
        if order is MessageOrder.REPEATED:
            self.repeated += 1
            return InputOutcome.LATE
        if order is MessageOrder.LATE:
            self.late += 1
            if not self.is_event:
                return InputOutcome.LATE
        self.show(message, arrival_ns)
        return InputOutcome.APPLIED

    def _observe(self, header: Header) -> MessageOrder:
        """Count a message's sequence number; messages skipped before it are not missing."""
        skipped = self.queue.skipped
        if skipped != self._skipped_seen:
            self._sequence.discount(skipped - self._skipped_seen)
            self._skipped_seen = skipped
        return self._sequence.observe(header)

    def _refuse(self, error: SchemaError) -> None:
        """Count a bad message; the last good value stands."""
        self.refused += 1
        self._sequence.discount(1)
        self.last_refusal = str(error)[:_MAX_REFUSAL]
        now = time.monotonic()
        if now - self._logged_at >= _LOG_INTERVAL_S:
            self._logged_at = now
            _log.warning("refused %s (%d so far): %s", self.topic.name, self.refused, error)


def _times(raw: RawMessage, offset: int, decode_ns: int) -> InputTimes:
    return InputTimes(raw.arrival_ns - raw.injected_ns, raw.injected_ns, offset, decode_ns)
