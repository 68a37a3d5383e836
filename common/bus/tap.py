"""A raw tap: sees every byte on a robot's bus and publishes nothing."""

import time
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import zenoh

from common.bus.session import tag_of


class RawSample(NamedTuple):
    """One message as it crossed the bus."""

    key: str
    payload: bytes
    tag: str
    """Schema tag given by the sender; empty if none."""
    arrival_ns: int
    """Monotonic (or simulated) time of arrival [ns]."""


class RawTap:
    """Collects everything published under ``<robot>/**`` in a bounded queue.

    The transport's thread only appends; when the reader falls behind, the oldest samples are let
    go and counted in :attr:`dropped`.
    """

    def __init__(
        self,
        session: "zenoh.Session",
        robot: str,
        maxlen: int = 20_000,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        """Subscribe; ``maxlen`` bounds the samples that wait to be drained."""
        self.dropped = 0
        """Samples let go because nobody drained in time."""
        self.received = 0
        self._queue: deque[RawSample] = deque()
        self._maxlen = maxlen
        self._clock = clock
        self._subscriber: Any = session.declare_subscriber(
            f"{robot}/**", self._receive, allowed_origin=zenoh.Locality.REMOTE
        )

    def drain(self) -> list[RawSample]:
        """Take out everything collected so far, oldest first."""
        queue = self._queue
        return [queue.popleft() for _ in range(len(queue))]

    def close(self) -> None:
        """Stop collecting; what was collected can still be drained."""
        self._subscriber.undeclare()

    def _receive(self, sample: Any) -> None:
        arrival_ns = self._clock()
        raw = RawSample(
            str(sample.key_expr), sample.payload.to_bytes(), tag_of(sample.encoding), arrival_ns
        )
        if len(self._queue) >= self._maxlen:
            try:
                self._queue.popleft()
            except IndexError:  # the reader took it just now
                pass
            else:
                self.dropped += 1
        self._queue.append(raw)
        self.received += 1
