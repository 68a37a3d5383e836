"""Measure the loop timing of a running service for its health message."""

import os
import time
from collections import deque
from typing import Any

from common.schemas import ServiceHealth

_WINDOW_S = 2.0
_MAX_KEPT = 4000


class LoopStats:
    """Counts steps and missed deadlines and keeps the durations of the last two seconds.

    Attributes:
        steps: counted so far.
        misses: steps that missed their deadline.
    """

    def __init__(self, service: str, period_ns: int, realtime: str) -> None:
        """Start at zero for the loop of ``service``; ``realtime`` is the scheduling in force."""
        self._service = service
        self._period_ns = period_ns
        self._realtime = realtime
        kept = round(_WINDOW_S * 1e9 / period_ns)
        self._durations: deque[int] = deque(maxlen=max(1, min(kept, _MAX_KEPT)))
        self.steps = 0
        self.misses = 0
        self._wall = time.monotonic()
        self._cpu = time.process_time()

    def count(self, duration_ns: int, missed: bool) -> None:
        """Count one step."""
        self.steps += 1
        self.misses += missed
        self._durations.append(duration_ns)

    def health(self, **more: Any) -> ServiceHealth:
        """Return the health message with ``more`` fields; the CPU is since the previous call."""
        wall, cpu = time.monotonic(), time.process_time()
        share = (cpu - self._cpu) / max(wall - self._wall, 1e-3)
        self._wall, self._cpu = wall, cpu
        ordered = sorted(self._durations)
        return ServiceHealth(
            service=self._service,
            pid=os.getpid(),
            period=1e-9 * self._period_ns,
            steps=self.steps,
            deadline_misses=self.misses,
            step_median=1e-9 * _quantile(ordered, 0.5),
            step_p99=1e-9 * _quantile(ordered, 0.99),
            cpu=max(0.0, share),
            realtime=self._realtime,
            **more,
        )


def _quantile(ordered: list[int], share: float) -> int:
    """Return an order statistic; 0 if there is no duration."""
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else 0
