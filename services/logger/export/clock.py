"""The recording's monotonic clock laid on the wall clock."""

from collections.abc import Mapping
from dataclasses import dataclass

from common.schemas import Header

LONGEST_JOURNEY_NS = 60_000_000_000
"""A sender's time further than this from the arrival is of another machine's clock [ns]."""


@dataclass(frozen=True, slots=True)
class Times:
    """When a message was made, sent and recorded: nanoseconds since 1970, wall clock."""

    stamp: int
    sent: int
    logged: int


@dataclass(frozen=True, slots=True)
class WallClock:
    """Adds what lies between the recorder's monotonic clock and its wall clock.

    Attributes:
        offset: wall minus monotonic [ns]; 0 if the log does not tell.
        known: whether the log tells.
    """

    offset: int = 0
    known: bool = False

    @classmethod
    def of(cls, origin: Mapping[str, str]) -> "WallClock":
        """The clock of a log with this ``origin`` (its first metadata record)."""
        try:
            return cls(int(origin["wall_ns"]) - int(origin["monotonic_ns"]), known=True)
        except (KeyError, ValueError):
            return cls()

    def times(self, header: Header, log_time: int) -> Times:
        """The moments of one message.

        The stamp is when its information was captured, or if that is not told when it was sent.
        A sender on another machine counts on a monotonic clock of its own, which shows by being
        far off; the arrival stands in for it then.

        Args:
            header: the message's header.
            log_time: its arrival, on the recorder's monotonic clock [ns].
        """
        sent = self._near(header.sent, log_time)
        captured = self._near(header.captured, sent)
        return Times(self.offset + captured, self.offset + sent, self.offset + log_time)

    @staticmethod
    def _near(told: int, otherwise: int) -> int:
        return told if told and abs(told - otherwise) <= LONGEST_JOURNEY_NS else otherwise
