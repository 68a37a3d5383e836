"""The bounded queue between the bus and the writer's thread."""

import threading
from collections import Counter

from common.bus.tap import RawSample


class Intake:
    """FIFO bounded by messages and by bytes; what does not fit is dropped and counted by key.

    The newest is dropped, not the oldest, so that what is recorded has one gap, not many.
    """

    def __init__(self, max_messages: int, max_bytes: int) -> None:
        """Make an empty queue that holds at most ``max_messages`` and ``max_bytes``."""
        self._max_messages = max_messages
        self._max_bytes = max_bytes
        self._lock = threading.Lock()
        self._queue: list[RawSample] = []
        self._bytes = 0
        self._dropped: Counter[str] = Counter()

    def offer(self, sample: RawSample) -> bool:
        """Append ``sample``; False if it was dropped."""
        size = len(sample.payload)
        with self._lock:
            if len(self._queue) >= self._max_messages or self._bytes + size > self._max_bytes:
                self._dropped[sample.key] += 1
                return False
            self._queue.append(sample)
            self._bytes += size
            return True

    def take(self) -> list[RawSample]:
        """Empty the queue, oldest first; returns at once."""
        with self._lock:
            taken, self._queue, self._bytes = self._queue, [], 0
        return taken

    def dropped(self) -> dict[str, int]:
        """How many were dropped so far, by key."""
        with self._lock:
            return dict(self._dropped)
