"""Counting what went missing, by the sequence numbers of each publisher."""

from collections import OrderedDict
from enum import Enum

from common.schemas import Header

_MAX_STREAMS = 64
_MAX_HOLES = 1024
MAX_JUMP = 1_000_000
"""A longer gap, more than an hour of the fastest topic, is believed only from two messages."""


class Arrival(Enum):
    """How a message's sequence number compares with those before it."""

    NEXT = "next"
    """Newer than all before (perhaps with a gap)."""
    LATE = "late"
    """Overtaken by a newer one."""
    REPEATED = "repeated"
    """It was there before."""
    WILD = "wild"
    """So far ahead that it is taken for damage: believing it would shut out all after it."""


class _Stream:
    """What one life of one publisher has shown."""

    def __init__(self, first: int) -> None:
        self.last = first
        self.floor = first
        """Below it is not known what was there."""
        self.holes: set[int] = set()

    def advance(self, seq: int) -> None:
        """Go on to a newer number, remembering what is missing up to it."""
        start = max(self.last + 1, seq - _MAX_HOLES)
        if start > self.last + 1:
            self.floor = start
        if start < seq:
            self.holes.update(range(start, seq))
            if len(self.holes) > _MAX_HOLES:
                self.holes = set(sorted(self.holes)[-_MAX_HOLES // 2 :])
                self.floor = max(self.floor, min(self.holes))
        self.last = seq

    def fill(self, seq: int) -> bool:
        """A number below the last came; whether it was missing."""
        if seq in self.holes:
            self.holes.remove(seq)
            return True
        return False


class SequenceTracker:
    """Follows the streams of one topic; a stream is one life of one publisher.

    Messages missing before the first seen do not count, nor does a publisher's restart. A late
    message fills the gap it left. A number that is wildly ahead is believed only once the next
    one follows it. The last thousand of the missing are remembered one by one, so that a message
    that comes late is told from one that comes again; what is older still counts as late.

    Attributes:
        missing: messages that never came, so far.
        late: messages that came after a newer one.
        repeated: messages that came more than once, each time but the first.
        streams_seen: lives of publishers.
    """

    def __init__(self) -> None:
        """Start having seen nothing."""
        self.missing = self.late = self.repeated = 0
        self.streams_seen = 0
        self._streams: OrderedDict[tuple[int, str], _Stream] = OrderedDict()
        self._excused = 0
        self._wild: dict[tuple[int, str], int] = {}

    def excuse(self, count: int) -> None:
        """Do not count the next ``count`` missing: they arrived, but were not decoded."""
        self._excused += count

    def observe(self, header: Header) -> Arrival:
        """Account for a message and say how it fits in."""
        key = (header.boot, header.source)
        stream = self._streams.get(key)
        if stream is None:
            self.streams_seen += 1
            self._streams[key] = _Stream(header.seq)
            if len(self._streams) > _MAX_STREAMS:
                self._streams.popitem(last=False)
            self._excused = 0
            return Arrival.NEXT
        last = stream.last
        if header.seq > last + MAX_JUMP and header.seq != self._wild.get(key, -1) + 1:
            self._wild = {key: header.seq}
            return Arrival.WILD
        if header.seq > last:
            jump = header.seq - last - 1
            excused = min(jump, self._excused)
            self._excused = 0
            self.missing += jump - excused
            stream.advance(header.seq)
            return Arrival.NEXT
        if stream.fill(header.seq):
            self.missing = max(0, self.missing - 1)
        elif header.seq >= stream.floor:
            self.repeated += 1
            return Arrival.REPEATED
        self.late += 1
        return Arrival.LATE
