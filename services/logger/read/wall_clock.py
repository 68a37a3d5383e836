"""Converts the recorder's monotonic clock to the wall clock."""

from collections.abc import Mapping
from dataclasses import dataclass

from common.schemas import Header

MAX_TRANSPORT_NS = 60_000_000_000
"""A sender's time further than this from the arrival belongs to another machine's clock [ns]."""


@dataclass(frozen=True, slots=True)
class Times:
    """When a message was captured, sent and recorded: nanoseconds since 1970, wall clock."""

    stamp: int
    sent: int
    logged: int


@dataclass(frozen=True, slots=True)
class WallClock:
    """The recorder's wall clock minus its monotonic clock [ns]; 0 if the log does not state it."""

    offset: int = 0
    known: bool = False

    @classmethod
    def of(cls, origin: Mapping[str, str]) -> "WallClock":
        """Return the clock of a log with this ``origin``, its first metadata record."""
        try:
            return cls(int(origin["wall_ns"]) - int(origin["monotonic_ns"]), known=True)
        except (KeyError, ValueError):
            return cls()

    def times(self, header: Header, log_time: int) -> Times:
        """Return the times of a message that arrived at ``log_time``, on the recorder's clock [ns].

        The stamp is when its information was captured; without that, when it was sent. A sender on
        another machine has a monotonic clock of its own, which is recognised by its large
        difference; the arrival is used instead.
        """
        sent = _if_near(header.sent, log_time)
        captured = _if_near(header.captured, sent)
        return Times(self.offset + captured, self.offset + sent, self.offset + log_time)


def _if_near(time: int, reference: int) -> int:
    """Return ``time`` if it is known and of the same clock as ``reference``, else that."""
    return time if time and abs(time - reference) <= MAX_TRANSPORT_NS else reference
