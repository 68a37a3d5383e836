"""Counting what went missing, by the sequence numbers of each publisher."""

from collections import OrderedDict
from enum import Enum

from common.schemas import Header

_MAX_STREAMS = 64
MAX_JUMP = 1_000_000
"""A longer gap, more than an hour of the fastest topic, is believed only from two messages."""


class Arrival(Enum):
    """How a message's sequence number compares with those before it."""

    NEXT = "next"
    """Newer than all before (perhaps with a gap)."""
    LATE = "late"
    """Overtaken by a newer one."""
    REPEATED = "repeated"
    """The same as the newest."""
    WILD = "wild"
    """So far ahead that it is taken for damage: believing it would shut out all after it."""


class SequenceTracker:
    """Follows the streams of one topic; a stream is one life of one publisher.

    Messages missing before the first seen do not count, nor does a publisher's restart. A late
    message fills the gap it left. A number that is wildly ahead is believed only once the next
    one follows it.
    """

    def __init__(self) -> None:
        """Start having seen nothing."""
        self.missing = 0
        self.streams_seen = 0
        self._last: OrderedDict[tuple[int, str], int] = OrderedDict()
        self._excused = 0
        self._wild: dict[tuple[int, str], int] = {}

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
        if header.seq > last + MAX_JUMP and header.seq != self._wild.get(stream, -1) + 1:
            self._wild = {stream: header.seq}
            return Arrival.WILD
        if header.seq > last:
            jump = header.seq - last - 1
            excused = min(jump, self._excused)
            self._excused = 0
            self.missing += jump - excused
            self._last[stream] = header.seq
            return Arrival.NEXT
        if header.seq == last:
            return Arrival.REPEATED
        self.missing = max(0, self.missing - 1)
        return Arrival.LATE
