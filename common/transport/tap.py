"""Collect every message on a robot's bus as bytes, without publishing anything."""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import zenoh

from common.transport.keys import received_as
from common.transport.session import tag_of

TRANSPORT_QUEUE = 4096
"""Samples that wait outside the interpreter, so that none is lost while it is busy."""

_log = logging.getLogger(__name__)


class RawSample(NamedTuple):
    """One message as it crossed the bus."""

    key: str
    payload: bytes
    tag: str
    """Schema tag given by the sender; empty if none."""
    arrival_ns: int
    """Monotonic (or simulated) time of arrival [ns]."""


class RawTap:
    """Collects what is published under ``<robot>/**``, or under given key expressions.

    The transport's thread only passes samples on: to ``deliver`` if given, else to a queue bounded
    by messages and bytes. When the reader of that queue falls behind, the oldest samples are
    dropped.

    Attributes:
        refused: messages put on wildcard keys, which are no topic's own, except those that may be
            sent to many robots at once: these are passed on under the key of this robot.
        error: the exception of ``deliver``, after which nothing more is delivered; None while it
            works. The owner of a tap with a ``deliver`` has to check it.
    """

    def __init__(
        self,
        session: "zenoh.Session",
        robot: str,
        maxlen: int = 20_000,
        clock: Callable[[], int] = time.monotonic_ns,
        *,
        max_bytes: int = 256 * 1024 * 1024,
        deliver: Callable[[RawSample], object] | None = None,
        expressions: Sequence[str] | None = None,
        accept: Callable[[str], bool] | None = None,
    ) -> None:
        """Subscribe.

        Args:
            session: an open Zenoh session.
            robot: first part of every key.
            maxlen: bounds the samples that wait to be drained.
            clock: returns the time of arrival [ns].
            max_bytes: bounds their payloads.
            deliver: called with each sample in a thread of the tap, instead of queueing it; must
                return at once. If that thread does not get to run for a while, up to
                :data:`TRANSPORT_QUEUE` samples wait for it in the transport.
            expressions: key expressions to subscribe to instead of ``<robot>/**``; may overlap.
            accept: called once for each key; returns whether its messages are wanted. None: all.
        """
        self.received = 0
        self.refused = 0
        self.error: Exception | None = None
        self._session: Any = session
        self._robot = robot
        self._queue: deque[RawSample] = deque()
        self._waiting_bytes = 0
        self._lock = threading.Lock()
        self._maxlen = maxlen
        self._max_bytes = max_bytes
        self._clock = clock
        self._delivers = deliver is not None
        self._deliver = deliver or self._enqueue
        self._accept = accept
        self._expressions: list[Any] = []
        self._subscribers: list[Any] = []
        self._readers: list[threading.Thread] = []
        for expression in expressions if expressions is not None else [f"{robot}/**"]:
            self.listen(expression)

    def listen(self, expression: str) -> None:
        """Subscribe to one more key expression; a key matched by several is delivered once."""
        wanted = zenoh.KeyExpr(expression)
        if any(known.includes(wanted) for known in self._expressions):
            return
        before = tuple(self._expressions)
        self._expressions.append(wanted)
        receive = self._receiver(before)
        handler: Any = zenoh.handlers.FifoChannel(TRANSPORT_QUEUE) if self._delivers else receive
        subscriber: Any = self._session.declare_subscriber(
            wanted, handler, allowed_origin=zenoh.Locality.REMOTE
        )
        self._subscribers.append(subscriber)
        if self._delivers:
            reader = threading.Thread(
                target=self._read, args=(subscriber, receive), name="tap", daemon=True
            )
            reader.start()
            self._readers.append(reader)

    def drain(self) -> list[RawSample]:
        """Remove and return everything collected so far, oldest first."""
        with self._lock:
            taken = list(self._queue)
            self._queue.clear()
            self._waiting_bytes = 0
        return taken

    def close(self) -> None:
        """Stop collecting; what was collected can still be drained."""
        for subscriber in self._subscribers:
            subscriber.undeclare()
        self._subscribers.clear()
        for reader in self._readers:
            reader.join()
        self._readers.clear()

    def _receiver(self, before: tuple[Any, ...]) -> Callable[[Any], None]:
        """Return a callback that passes on samples that no expression of ``before`` matches."""
        decided: dict[str, str | None] = {}
        refused: set[str] = set()
        clock, deliver = self._clock, self._deliver

        def decide(key: str) -> str | None:
            """Return the key under which samples of ``key`` are passed on; None: not."""
            own = received_as(self._robot, key)
            if own is None:
                refused.add(key)
                _log.warning("messages on the wildcard key %r are refused", key)
                return None
            if any(other.intersects(zenoh.KeyExpr(key)) for other in before):
                return None
            return own if self._accept is None or self._accept(own) else None

        def receive(sample: Any) -> None:
            arrival_ns = clock()
            key = str(sample.key_expr)
            if key not in decided:
                decided[key] = decide(key)
            own = decided[key]
            if own is None:
                self.refused += key in refused
                return
            self.received += 1
            deliver(RawSample(own, sample.payload.to_bytes(), tag_of(sample.encoding), arrival_ns))

        return receive

    def _read(self, subscriber: Any, receive: Callable[[Any], None]) -> None:
        """Deliver what arrives until the subscriber is undeclared."""
        try:
            for sample in subscriber:
                receive(sample)
        except Exception as error:  # noqa: BLE001 - nobody waits for this thread
            self.error = self.error or error

    def _enqueue(self, raw: RawSample) -> None:
        queue = self._queue
        with self._lock:
            queue.append(raw)
            self._waiting_bytes += len(raw.payload)
            while len(queue) > self._maxlen or self._waiting_bytes > self._max_bytes:
                self._waiting_bytes -= len(queue.popleft().payload)
