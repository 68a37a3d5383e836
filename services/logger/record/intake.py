"""Queues samples between the bus and the writer's thread."""

import threading

from common.transport.tap import RawSample
from common.wire.header import wire_header
from services.logger.read.delivery import DeliveryStats


class Intake:
    """FIFO bounded by messages and by bytes; samples that do not fit are dropped and counted.

    The newest sample is dropped, not the oldest, so that the recording has one gap instead of
    many. Its header is read all the same, which keeps the delivery statistics exact.

    Attributes:
        dropped: number of samples dropped so far.
    """

    def __init__(self, max_messages: int, max_bytes: int) -> None:
        """Make an empty queue that holds at most ``max_messages`` and ``max_bytes``."""
        self._max_messages = max_messages
        self._max_bytes = max_bytes
        self._lock = threading.Lock()
        self._queue: list[RawSample] = []
        self._bytes = 0
        self._drops = DeliveryStats()
        self.dropped = 0

    def offer(self, sample: RawSample) -> bool:
        """Append ``sample``; return False if it was dropped."""
        size = len(sample.payload)
        with self._lock:
            if len(self._queue) < self._max_messages and self._bytes + size <= self._max_bytes:
                self._queue.append(sample)
                self._bytes += size
                return True
        header = wire_header(sample.payload)
        with self._lock:
            self._drops.drop(sample.key, header)
            self.dropped += 1
        return False

    def take(self) -> list[RawSample]:
        """Empty the queue and return the samples, oldest first, without waiting."""
        with self._lock:
            taken, self._queue, self._bytes = self._queue, [], 0
        return taken

    def take_drops(self) -> DeliveryStats:
        """Return what was dropped since the last call."""
        with self._lock:
            if not self._drops:
                return self._drops
            taken, self._drops = self._drops, DeliveryStats()
        return taken
