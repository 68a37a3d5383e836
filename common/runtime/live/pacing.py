"""Decide when the next step is due, from times [ns]. Pure."""


class ClockPace:
    """Steps on a fixed grid; steps that could not be run in time are skipped."""

    def __init__(self, period_ns: int, start_ns: int) -> None:
        """The first step is due at ``start_ns``."""
        self._period = period_ns
        self.due_ns = start_ns

    def ended(self, now_ns: int) -> bool:
        """Plan the next step after one ended at ``now_ns``; returns whether it missed its deadline.

        The deadline is the time at which the next step is due. After a miss the grid's next
        future point is taken, so there is neither a burst nor a shift of phase.
        """
        self.due_ns += self._period
        if now_ns <= self.due_ns:
            return False
        behind = (now_ns - self.due_ns) // self._period
        # A step that is late by less than a period is run at once.
        self.due_ns += behind * self._period
        return True


class TriggerPace:
    """Steps on arrivals, at most one per period on average, locked to their phase.

    Arrivals may come several per period (states at 200 Hz, steps at 100 Hz). The expected time of
    the next step follows the arrivals that started one through a first-order filter, so one late
    arrival does not move the phase, and an arrival counts as the expected one when it comes no
    earlier than ``tolerance`` before it. A sender that floods can thereby raise the rate by
    ``GAIN * tolerance / period`` at most, a few percent. Without an arrival the step runs 1.5
    periods after the previous one.
    """

    GAIN = 0.1
    """Share of a phase error that is corrected at each step."""

    def __init__(self, period_ns: int, interval_ns: int, start_ns: int) -> None:
        """Start unlocked: the first arrival starts a step.

        Steps have the nominal ``period_ns``, arrivals ``interval_ns``. Half of the latter, but no
        more than half a period, is the tolerance for early ones.
        """
        self._period = period_ns
        self._tolerance = min(interval_ns, period_ns) // 2
        self._expected = start_ns
        self._locked = False
        self.due_ns = start_ns + 3 * period_ns // 2
        """When the step runs even without an arrival."""

    def accepts(self, arrival_ns: int) -> bool:
        """Return whether an arrival starts a step; if so, the phase follows it."""
        error = arrival_ns - self._expected
        if self._locked and error < -self._tolerance:
            return False
        if self._locked and error <= self._period // 2:
            self._expected += self._period + round(self.GAIN * error)
        else:
            self._expected = arrival_ns + self._period
            self._locked = True
        self.due_ns = arrival_ns + 3 * self._period // 2
        return True

    def timed_out(self, now_ns: int) -> None:
        """Note that a step is run without an arrival."""
        self._expected = now_ns + self._period
        self.due_ns = now_ns + 3 * self._period // 2

    def ended(self, now_ns: int, started_ns: int) -> bool:
        """Return whether a step begun at ``started_ns`` missed its deadline of one period."""
        return now_ns - started_ns > self._period
