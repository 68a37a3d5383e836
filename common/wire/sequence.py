"""Count missing, late and repeated messages by the sequence numbers of each publisher."""

from collections import OrderedDict
from enum import Enum

from common.schemas import Header

_MAX_RUNS = 64
_MAX_MISSING = 1024
_MAX_AHEAD = 7
MAX_JUMP = 1000
"""A longer gap, five seconds of the fastest topic, is believed only from two messages: one stray
number would make all later messages late, and thousands count as missing."""


class MessageOrder(Enum):
    """How a message's sequence number compares with those before it."""

    NEXT = "next"
    """Newer than all before (perhaps after a gap)."""
    LATE = "late"
    """Overtaken by a newer one."""
    REPEATED = "repeated"
    """Received before."""
    IMPLAUSIBLE = "implausible"
    """So far ahead that it is taken for damage: believing it would make all later ones late."""


class _PublisherRun:
    """Sequence numbers received from one publisher since it started."""

    def __init__(self, first: int) -> None:
        self.last = first
        self.floor = first
        """Numbers below it are not remembered."""
        self.missing: set[int] = set()
        self.ahead: list[int] = []
        """Numbers that came since the last, too far ahead to be believed alone."""

    def is_plausible(self, seq: int) -> bool:
        """Whether a number is near the last one, or confirms an earlier jump by following it."""
        if seq <= self.last + MAX_JUMP:
            self.ahead.clear()
            return True
        if self.ahead and self.ahead[-1] < seq <= self.ahead[-1] + MAX_JUMP:
            return True
        self.ahead = [*self.ahead[-_MAX_AHEAD:], seq]
        return False

    def advance(self, seq: int) -> None:
        """Move on to a newer number and remember the numbers missing before it."""
        start = max(self.last + 1, seq - _MAX_MISSING)
        if start > self.last + 1:
            self.floor = start
        if start < seq:
            self.missing.update(range(start, seq))
            if len(self.missing) > _MAX_MISSING:
                self.missing = set(sorted(self.missing)[-_MAX_MISSING // 2 :])
                self.floor = max(self.floor, min(self.missing))
        self.last = seq

    def fill_gap(self, seq: int) -> bool:
        """Note a number below the last; returns whether it was missing."""
        if seq in self.missing:
            self.missing.remove(seq)
            return True
        return False


class SequenceTracker:
    """Follows the sequence numbers of one topic, apart for each run of each publisher.

    Messages missing before the first received do not count, nor does a publisher's restart. A late
    message fills the gap it left. A number that is implausibly far ahead is believed only once
    another one follows it. The last thousand missing numbers are remembered, so that a late message
    is distinguished from a repeated one; older ones count as late.

    Attributes:
        missing: messages that never came, so far.
        late: messages that came after a newer one.
        repeated: messages that came more than once, each time but the first.
    """

    def __init__(self) -> None:
        """Start with nothing received."""
        self.missing = self.late = self.repeated = 0
        self._runs: OrderedDict[tuple[int, str], _PublisherRun] = OrderedDict()
        self._discount = 0

    def discount(self, count: int) -> None:
        """Leave ``count`` messages out of the next gap: they arrived, but were not decoded."""
        self._discount += count

    def observe(self, header: Header) -> MessageOrder:
        """Count a message and return how it fits in."""
        key = (header.boot, header.source)
        run = self._runs.get(key)
        if run is None:
            self._runs[key] = _PublisherRun(header.seq)
            if len(self._runs) > _MAX_RUNS:
                self._runs.popitem(last=False)
            self._discount = 0
            return MessageOrder.NEXT
        if header.seq == run.last + 1 and not (run.ahead or self._discount):
            run.last = header.seq
            return MessageOrder.NEXT
        if not run.is_plausible(header.seq):
            return MessageOrder.IMPLAUSIBLE
        if header.seq > run.last:
            gap = header.seq - run.last - 1 - len(run.ahead)
            run.ahead.clear()
            self.missing += max(0, gap - self._discount)
            self._discount = 0
            run.advance(header.seq)
            return MessageOrder.NEXT
        if run.fill_gap(header.seq):
            self.missing = max(0, self.missing - 1)
        elif header.seq >= run.floor:
            self.repeated += 1
            return MessageOrder.REPEATED
        self.late += 1
        return MessageOrder.LATE
