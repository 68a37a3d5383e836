"""Estimate the offset between two processes' monotonic clocks from exchanged times. Pure.

One exchange: this side asks at ``asked``, the other receives at ``received`` and answers at
``answered`` by its own clock, and the answer is back at ``returned``. With offset = this clock
minus the other, and since no message arrives before it was sent::

    asked - received <= offset <= returned - answered

The interval is as wide as the round trip. Its middle is therefore off by half the round trip at
most, however unequal the two ways are and whatever the delays' distribution is; nothing is
averaged and no symmetry is assumed. Clocks of different hosts also drift apart, so an interval
grows as it ages. Two exchanges whose intervals, so grown, do not meet cannot both be of one
clock: it was set or replaced between them, and only what came after counts.
"""

from collections import deque
from typing import NamedTuple

MAX_DRIFT = 2e-4
"""How fast two clocks may drift apart: twice the 100 ppm of a poor quartz."""
WINDOW = 16
"""Exchanges remembered."""


class Exchange(NamedTuple):
    """Four times [ns]: ``asked`` and ``returned`` of this clock, the others of the other's."""

    asked: int
    received: int
    answered: int
    returned: int

    @property
    def round_trip(self) -> int:
        """Time on the way, both ways together [ns]."""
        return (self.returned - self.asked) - (self.answered - self.received)

    @property
    def offset(self) -> int:
        """This clock minus the other [ns], within half a round trip."""
        return (self.asked - self.received + self.returned - self.answered) // 2


class Offset(NamedTuple):
    """An estimate [ns]: the truth is ``offset`` ± ``error``."""

    offset: int
    error: int


class OffsetEstimator:
    """Estimates the offset to one other clock from the exchanges with it.

    The estimate is that of the remembered exchange with the smallest error now: half its round
    trip, and what the clocks may have drifted apart since.
    """

    def __init__(self, max_drift: float = MAX_DRIFT, window: int = WINDOW) -> None:
        """Keep ``window`` exchanges of clocks that drift apart by at most ``max_drift`` [s/s]."""
        self.steps = 0
        """Times the other clock (or this one) was found to have been set."""
        self._max_drift = max_drift
        self._exchanges: deque[Exchange] = deque(maxlen=window)

    def add(self, exchange: Exchange) -> bool:
        """Add an exchange; False if its times contradict each other and it is not used."""
        if exchange.round_trip < 0 or exchange.returned < exchange.asked:
            return False
        if any(self._contradict(exchange, known) for known in self._exchanges):
            self.steps += 1
            self._exchanges.clear()
        self._exchanges.append(exchange)
        return True

    def estimate(self, now_ns: int) -> Offset | None:
        """Return the best estimate at a time of this clock; None before the first exchange."""
        if not self._exchanges:
            return None
        best = min(self._exchanges, key=lambda exchange: self._error(exchange, now_ns))
        return Offset(best.offset, self._error(best, now_ns))

    def _error(self, exchange: Exchange, now_ns: int) -> int:
        age = abs(now_ns - exchange.returned)
        # The middle is rounded down to a whole nanosecond.
        return exchange.round_trip // 2 + 1 + round(self._max_drift * age)

    def _contradict(self, new: Exchange, old: Exchange) -> bool:
        """Return whether no single offset fits both."""
        apart = abs(new.offset - old.offset)
        return apart > self._error(new, new.returned) + self._error(old, new.returned)
