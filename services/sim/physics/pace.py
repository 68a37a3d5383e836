"""Keeping robot time in step with the runner's clock."""

from common.plant.config import PHYSICS_STEP_NS


class Pace:
    """Says how many physics steps are due, and gives up those that cannot be caught up.

    A short hiccup is made up by running a few steps at once; after a longer one robot time
    falls behind the clock for good, rather than the robot rushing after it.

    Attributes:
        late_steps: physics steps given up so far.
    """

    def __init__(self, first_steps: int, catch_up_steps: int) -> None:
        """Run ``first_steps`` at the first call and at most ``catch_up_steps`` at any other."""
        self.late_steps = 0
        self._first_steps = first_steps
        self._catch_up_steps = catch_up_steps
        self._simulated_until_ns: int | None = None

    def due(self, now_ns: int) -> int:
        """Return the number of steps to run now; ``now_ns`` is the runner's clock [ns]."""
        if self._simulated_until_ns is None:
            self._simulated_until_ns = now_ns
            return self._first_steps
        behind_ns = now_ns - self._simulated_until_ns
        # To the nearest step: with jittery calls, one each, not none now and two the next time.
        steps = max(0, (2 * behind_ns + PHYSICS_STEP_NS) // (2 * PHYSICS_STEP_NS))
        self._simulated_until_ns += steps * PHYSICS_STEP_NS
        run = min(steps, self._catch_up_steps)
        self.late_steps += steps - run
        return run

    def skip(self, now_ns: int) -> None:
        """Let the clock pass to ``now_ns`` without steps, as while paused."""
        self._simulated_until_ns = now_ns


class Every:
    """True once per period of the runner's clock."""

    def __init__(self, rate: int) -> None:
        """``rate`` per second."""
        self._period_ns = 1_000_000_000 // rate
        self._next_ns: int | None = None

    def due(self, now_ns: int) -> bool:
        """Whether a period has begun since the last True; the first call is True."""
        if self._next_ns is None:
            self._next_ns = now_ns
        if now_ns < self._next_ns:
            return False
        self._next_ns += self._period_ns
        if self._next_ns <= now_ns:
            self._next_ns = now_ns + self._period_ns
        return True
