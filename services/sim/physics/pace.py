"""Scheduling of physics steps and periodic outputs by the runner's clock."""

from common.plant.config import PHYSICS_STEP_NS


class Pace:
    """Computes how many physics steps are due, and drops those that cannot be caught up.

    A short delay is made up by a few steps at once. After a longer one robot time stays behind the
    clock, so that the robot does not move faster than real time.

    Attributes:
        late_steps: physics steps dropped so far.
    """

    def __init__(self, first_steps: int, catch_up_steps: int) -> None:
        """Set how many steps are due at the first call, and at most at any other.

        Args:
            first_steps: at the first call.
            catch_up_steps: limit at later calls.
        """
        self.late_steps = 0
        self._first_steps = first_steps
        self._catch_up_steps = catch_up_steps
        self._simulated_until_ns: int | None = None

    def due(self, now_ns: int) -> int:
        """Return the number of steps to run at the runner's time ``now_ns`` [ns]."""
        if self._simulated_until_ns is None:
            self._simulated_until_ns = now_ns
            return self._first_steps
        behind_ns = now_ns - self._simulated_until_ns
        # Rounded to the nearest step, so that jittery calls get one step each instead of 0 and 2.
        steps = max(0, (2 * behind_ns + PHYSICS_STEP_NS) // (2 * PHYSICS_STEP_NS))
        self._simulated_until_ns += steps * PHYSICS_STEP_NS
        run = min(steps, self._catch_up_steps)
        self.late_steps += steps - run
        return run

    def skip(self, now_ns: int) -> None:
        """Let the clock advance to ``now_ns`` without steps, as during a pause."""
        self._simulated_until_ns = now_ns


class RateTimer:
    """Tells once per period of the runner's clock that an output is due.

    Attributes:
        next_ns: time from which it is due [ns]; before 0: at once.
    """

    def __init__(self, rate: int) -> None:
        """Set the rate [Hz]."""
        self._period_ns = 1_000_000_000 // rate
        self.next_ns = -self._period_ns

    def due(self, now_ns: int) -> bool:
        """Return whether a period has begun since the last True; the first call is True."""
        if now_ns < self.next_ns:
            return False
        self.next_ns += self._period_ns
        if self.next_ns <= now_ns:
            self.next_ns = now_ns + self._period_ns
        return True
