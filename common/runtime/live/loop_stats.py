"""Measure the loop timing of a running service for its health message."""

import os
import time
from collections import deque

from common.inbox.inbox import Inbox
from common.runtime.service import Service
from common.schemas import ServiceHealth

_WINDOW_S = 2.0
_MAX_KEPT = 4000


class LoopStats:
    """Counts steps and missed deadlines and keeps the durations of the last two seconds.

    Attributes:
        steps: counted so far.
        misses: steps that missed their deadline.
    """

    def __init__(self, service: Service, realtime: str) -> None:
        """Start at zero.

        Args:
            service: whose loop it is.
            realtime: the scheduling in force, in words.
        """
        self._service = service
        self._realtime = realtime
        kept = round(_WINDOW_S * 1e9 / service.period_ns)
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

    def health(self, inbox: Inbox) -> ServiceHealth:
        """Return the health message; its share of CPU is since the previous call."""
        wall, cpu = time.monotonic(), time.process_time()
        share = (cpu - self._cpu) / max(wall - self._wall, 1e-3)
        self._wall, self._cpu = wall, cpu
        ordered = sorted(self._durations)
        return ServiceHealth(
            service=self._service.name,
            pid=os.getpid(),
            period=1e-9 * self._service.period_ns,
            steps=self.steps,
            deadline_misses=self.misses,
            step_median=1e-9 * _quantile(ordered, 0.5),
            step_p99=1e-9 * _quantile(ordered, 0.99),
            cpu=max(0.0, share),
            realtime=self._realtime,
            links=inbox.link_health(),
        )


def _quantile(ordered: list[int], share: float) -> int:
    """Return an order statistic; 0 if there is no duration."""
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else 0
