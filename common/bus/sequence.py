"""Counting what went missing, by the sequence numbers of each publisher."""

from collections import OrderedDict
from enum import Enum

from common.schemas import Header

_MAX_STREAMS = 64
_MAX_JUMP = 1_000_000


class Arrival(Enum):
    """How a message's sequence number compares with those before it."""

    NEXT = "next"
    """Newer than all before (perhaps with a gap)."""
    LATE = "late"
    """Overtaken by a newer one."""
    REPEATED = "repeated"
    """The same as the newest."""


class SequenceTracker:
    """Follows the streams of one topic; a stream is one life of one publisher.

    Messages missing before the first seen do not count, nor does a publisher's restart. A late
    message fills the gap it left.
    """

    def __init__(self) -> None:
        """Start having seen nothing."""
        self.missing = 0
        self.streams_seen = 0
        self._last: OrderedDict[tuple[int, str], int] = OrderedDict()
        self._excused = 0

    def excuse(self, count: int) -> None:
        """Do not count the next ``count`` missing: they arrived, but were not decoded."""
        self._excused += count

    def observe(self, header: Header) -> Arrival:
        """Account for a message and say how it fits in."""
        stream = (header.boot, header.source)
        last = self._last.get(stream)
        if last is None:
            self.streams_seen += 1
            self._last[stream] = header.seq
            if len(self._last) > _MAX_STREAMS:
                self._last.popitem(last=False)
            self._excused = 0
            return Arrival.NEXT
        if header.seq > last:
            jump = header.seq - last - 1
            excused = min(jump, self._excused)
            self._excused = 0
            # A wild number is a damaged message, not a million lost ones.
            self.missing += min(jump - excused, _MAX_JUMP)
            self._last[stream] = header.seq
            return Arrival.NEXT
        if header.seq == last:
            return Arrival.REPEATED
        self.missing = max(0, self.missing - 1)
        return Arrival.LATE
