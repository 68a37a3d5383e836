"""How often an operator repeats what has not changed: its claim, that its stop button works."""

from typing import Final

_PERIOD_NS: Final = 100_000_000
_EARLY_NS: Final = 20_000_000
"""A message may come this much early, so that a step that is not quite due need not wait for the
next."""


def next_due_ns(now_ns: int) -> int:
    """Return from when on a message sent now is to be repeated, at 10 Hz [ns]."""
    return now_ns + _PERIOD_NS - _EARLY_NS
