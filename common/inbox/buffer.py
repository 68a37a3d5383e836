"""Hold one input of a service: payloads that wait, the last good value, counters."""

import logging
import time
from collections import OrderedDict, deque
from math import inf
from typing import Any

from common.errors import SchemaError
from common.inbox.arrivals import WILDCARD, ArrivalQueue, RawMessage
from common.inbox.context import NO_LIMIT, FollowedSender, InboxContext
from common.journal.journal import Journal
from common.journal.tables import UNKNOWN, InputOutcome, InputTimes
from common.links.delay import DelayLine
from common.schemas import Header, Message, Sender
from common.topics import Delivery, Topic
from common.wire.codec import schema_tag
from common.wire.decoder import Decoder
from common.wire.header import wire_header
from common.wire.sequence import MessageOrder, SequenceTracker

_RATE_WINDOW_NS = 1_000_000_000
_RATE_KEPT = 4096
_MAX_SENDERS = 64
_MAX_HISTORY = 4096
_LOG_INTERVAL_S = 1.0
_MAX_REFUSAL = 400

_log = logging.getLogger(__name__)


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
        refused, late, repeated, stale, adapted, foreign: as in
            :class:`~common.schemas.LinkHealth`.
        last_refusal: why the last message that was refused, or had no age, was not applied.
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
            max_age: messages older than this on arrival are not applied, and the last good one is
                fresh for as long [s]; None: the topic's own.
        """
        self.topic = topic
        self._context = context or InboxContext()
        age = topic.max_age if max_age is None else max_age
        self._max_age_ns = round(1e9 * age) if age < 1e9 else NO_LIMIT
        self._followed = FollowedSender(self._max_age_ns) if topic.exclusive else None
        self.is_event = topic.delivery is Delivery.EVENT
        schema: type[Message] = topic.schema
        self._tag = schema_tag(schema)
        self._decoder = Decoder(schema)
        self.queue = ArrivalQueue(is_event=self.is_event)
        if line is not None:
            self.queue.set_line(line)
        self.value: Message | None = None
        self.by_sender: OrderedDict[Sender, Message] = OrderedDict()
        self._newest: Sender | None = None
        """The last in :attr:`by_sender`."""
        self.events: list[Message] = []
        self.updated = False
        self.good_ns = 0
        self.received = self.refused = self.late = self.repeated = self.stale = self.adapted = 0
        self.foreign = 0
        self.last_refusal = ""
        self._sequence = SequenceTracker()
        self._skipped_seen = 0
        self._arrivals: deque[int] = deque(maxlen=_RATE_KEPT)
        self._history: deque[tuple[int, Message]] = deque(maxlen=_MAX_HISTORY)
        self._history_ns = 0
        self._logged_at = -_LOG_INTERVAL_S

    @property
    def gaps(self) -> int:
        """Messages missing by sequence number, so far."""
        return self._sequence.missing

    def age(self, now_ns: int) -> float:
        """Seconds since the last good message arrived; infinity before the first."""
        return 1e-9 * (now_ns - self.good_ns) if self.value is not None else inf

    def is_fresh(self, now_ns: int) -> bool:
        """Whether the last good message arrived within the largest age that is applied."""
        return self.value is not None and now_ns - self.good_ns <= self._max_age_ns

    def release(self, now_ns: int) -> bool:
        """Pass payloads through the link, if any; returns whether any fell due by ``now_ns``."""
        return self.queue.release(now_ns, self._record_lost)

    def take_in(self) -> bool:
        """Decode all messages that are ready; returns whether one became visible.

        Messages that arrive meanwhile are left for the next step, so that a flood cannot keep this
        one from ending.
        """
        queue = self.queue
        for _ in range(len(queue.ready)):
            raw = queue.pop()
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
        if self._history_ns:
            self._history.append((arrival_ns, message))
            self._forget()
        header, newest = message.header, self._newest
        if newest is None or header.boot != newest.boot or header.source != newest.source:
            newest = self._newest = header.sender
            self.by_sender[newest] = message
            self.by_sender.move_to_end(newest)
            if len(self.by_sender) > _MAX_SENDERS:
                self.by_sender.popitem(last=False)
        else:
            self.by_sender[newest] = message

    def history(self, span_ns: int) -> list[Message]:
        """Return good messages that arrived up to ``span_ns`` before the newest, oldest first.

        They are kept from the first call on, for the longest span that was asked for.
        """
        if span_ns > self._history_ns:
            if not self._history_ns and self.value is not None:
                self._history.append((self.good_ns, self.value))
            self._history_ns = span_ns
        return [message for at, message in self._history if self.good_ns - at <= span_ns]

    def _forget(self) -> None:
        """Remove what is too long ago for the history."""
        history, start = self._history, self.good_ns - self._history_ns
        while history[0][0] < start:
            history.popleft()

    def _process(self, raw: RawMessage) -> None:
        """Decode one message, decide about it and record it."""
        clock, journal = self._context.clock, self._context.journal
        started = clock() if clock else 0
        try:
            if raw.tag == WILDCARD:
                raise SchemaError("put on a wildcard key; expected the topic's own")
            message = self._decoder.decode(raw.payload, raw.tag, raw.injected_ns)
        except SchemaError as error:
            self._refuse(error)
            if journal is not None:
                head = wire_header(raw.payload)
                self._record(journal, InputOutcome.REFUSED, head, raw, _times(raw, UNKNOWN, 0))
            return
        self.adapted += raw.tag is not None and raw.tag != self._tag
        header = message.header
        offset = self._context.offset_of(header)
        outcome = self._judge_sender(header, offset, raw.arrival_ns - raw.injected_ns)
        if outcome is InputOutcome.APPLIED:
            outcome = self._accept(message, raw.arrival_ns)
        else:
            self._observe(header)
        if journal is not None:
            decode_ns = clock() - started if clock else 0
            self._record(journal, outcome, header, raw, _times(raw, offset, decode_ns))

    def _judge_sender(self, header: Header, offset: int, arrived_ns: int) -> InputOutcome:
        """Decide by age and sender whether a message may be applied."""
        followed = self._followed
        limit = self._max_age_ns
        old = limit < NO_LIMIT and self._context.is_too_old(header, offset, arrived_ns, limit)
        ours = followed is None or followed.takes(header, arrived_ns, old=old)
        if old:
            self.stale += 1
            if offset == UNKNOWN:
                self._say(
                    f"{header.source or 'a nameless sender'} does not tell its clock, so the age "
                    "of its messages is unknown; it has to answer clock queries"
                )
            return InputOutcome.STALE
        if followed is None or ours:
            return InputOutcome.APPLIED
        self.foreign += 1
        self._say(f"message from {_name(header.sender)}, following {_name(followed.sender)}")
        return InputOutcome.FOREIGN

    def _record_lost(self, raw: RawMessage) -> None:
        """Record a message that the link dropped on purpose."""
        journal = self._context.journal
        if journal is not None:
            times = InputTimes(raw.arrival_ns, injected=-1, offset=UNKNOWN, decode=0)
            self._record(journal, InputOutcome.LOST, wire_header(raw.payload), raw, times)

    def _record(
        self,
        journal: Journal,
        outcome: InputOutcome,
        header: Header | None,
        raw: RawMessage,
        times: InputTimes,
    ) -> None:
        """Write an input record to the journal."""
        tag = self._tag if raw.tag is None else raw.tag
        journal.record(self.topic.name, outcome, header, raw.payload, tag, times)

    def _accept(self, message: Message, arrival_ns: int) -> InputOutcome:
        """Show a good message, unless it repeats or (for a latest value) was overtaken."""
        order = self._observe(message.header)
        if order is MessageOrder.IMPLAUSIBLE:
            self.refused += 1
            self._say(f"sequence number {message.header.seq} is far beyond the last")
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
        self._say(str(error))

    def _say(self, why: str) -> None:
        """Note why a message was not applied, and log it once a second at most."""
        self.last_refusal = why[:_MAX_REFUSAL]
        now = time.monotonic()
        if now - self._logged_at >= _LOG_INTERVAL_S:
            self._logged_at = now
            count = self.refused + self.foreign + self.stale
            _log.warning("refused %s (%d so far): %s", self.topic.name, count, why)


def _name(sender: Sender | None) -> str:
    return "nobody" if sender is None else f"{sender.source} boot {sender.boot:x}"


def _times(raw: RawMessage, offset: int, decode_ns: int) -> InputTimes:
    return InputTimes(raw.arrival_ns - raw.injected_ns, raw.injected_ns, offset, decode_ns)
