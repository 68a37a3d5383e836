"""Finds out how far the clocks of the services one hears are from one's own.

Every live service answers queries on ``<robot>/clock/<service>`` with the times at which it
received and answered them, its life's id and which clock it goes by. Every live service asks
those whose messages it takes in: at once when the first comes, a few times in short order, then
once a second as long as messages come. Processes that go by the same clock (same kernel, same
time namespace) have an offset of exactly 0 and are not asked again. Wall clocks play no part.
"""

import contextlib
import hashlib
import logging
import os
import secrets
import struct
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import zenoh

from common.journal.journal import UNKNOWN
from common.runtime.live.components import NEVER, Component, RunnerContext
from common.runtime.live.offset_estimator import Exchange, Offset, OffsetEstimator
from common.schemas import Header

_log = logging.getLogger(__name__)

_ANSWER = struct.Struct("<4s16sqqq")
"""Magic, clock, boot, received [ns], answered [ns]."""
_MAGIC = b"clk1"
_FIRST_PINGS = 4
_FIRST_PERIOD_NS = 100_000_000
_PERIOD_NS = 1_000_000_000
_LOOK_PERIOD_NS = 250_000_000
_TIMEOUT_S = 5.0
_MAX_PEERS = 64


def clock_identity() -> bytes:
    """Name the monotonic clock of this process: equal in processes that share it (16 bytes).

    A kernel's boot id and the time namespace. Where there is no such thing, no two processes are
    taken to share a clock.
    """
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_bytes()
    except OSError:
        return secrets.token_bytes(16)
    try:
        namespace = os.stat("/proc/self/ns/time").st_ino
    except OSError:  # a kernel without time namespaces has one clock
        namespace = 0
    return hashlib.sha256(boot + str(namespace).encode()).digest()[:16]


class Answer(NamedTuple):
    """What the other side says; times of its clock [ns]."""

    clock: bytes
    boot: int
    received: int
    answered: int


def pack_answer(answer: Answer) -> bytes:
    """Return the bytes of an answer."""
    return _ANSWER.pack(_MAGIC, *answer)


def unpack_answer(payload: bytes) -> Answer | None:
    """Read an answer; None if it is none."""
    if len(payload) != _ANSWER.size:
        return None
    magic, *fields = _ANSWER.unpack(payload)
    return Answer(*fields) if magic == _MAGIC else None


class _Peer:
    """One life of one source."""

    def __init__(self, source: str, now_ns: int) -> None:
        self.source = source
        self.offset = UNKNOWN
        self.heard = True
        self.same_clock = False
        self.pings = 0
        self.next_ping = now_ns
        self.estimator = OffsetEstimator()

    def pinged(self, now_ns: int) -> None:
        """Plan the next ping; none while nothing is heard."""
        self.pings += 1
        self.heard = False
        period = _FIRST_PERIOD_NS if self.pings < _FIRST_PINGS else _PERIOD_NS
        self.next_ping = now_ns + period

    def estimate(self, now_ns: int) -> Offset | None:
        return Offset(0, 0) if self.same_clock else self.estimator.estimate(now_ns)


class ClockSync(Component):
    """Answers the pings of others and pings those who are heard."""

    def __init__(
        self, clock: Callable[[], int] = time.monotonic_ns, identity: bytes | None = None
    ) -> None:
        """Stamp by ``clock`` [ns], called ``identity``; None: the system's monotonic clock."""
        self._clock = clock
        self._identity = identity or clock_identity()
        self._peers: dict[tuple[str, int], _Peer] = {}
        self._newest: dict[str, _Peer] = {}
        self._answers: deque[tuple[str, int, int, bytes]] = deque(maxlen=4 * _MAX_PEERS)
        self._queriers: dict[str, Any] = {}
        self._context: RunnerContext | None = None
        self._next_look = 0
        self._stale = 0

    @property
    def sources(self) -> tuple[str, ...]:
        """Everybody whose messages were taken in so far."""
        return tuple(self._newest)

    def offset_of(self, header: Header) -> int:
        """This clock minus that of a message's sender [ns]; UNKNOWN if not known (yet)."""
        peer = self._peers.get((header.source, header.boot))
        if peer is None:
            return self._meet(header.source, header.boot)
        peer.heard = True
        return peer.offset

    def known(self, source: str) -> Offset | None:
        """The estimate for a source's newest life [ns]."""
        peer = self._newest.get(source)
        return None if peer is None else peer.estimate(self._clock())

    def open(self, context: RunnerContext) -> None:
        """Begin to answer."""
        self._context = context
        clock, identity, boot = self._clock, self._identity, context.boot

        def answer(query: Any) -> None:
            received = clock()
            payload = pack_answer(Answer(identity, boot, received, clock()))
            with contextlib.suppress(zenoh.ZError):  # who asked has left, or we are leaving
                query.reply(query.key_expr, payload, express=True)

        key = f"{context.robot}/clock/{context.service}"
        self._queryable = context.session.declare_queryable(key, answer)

    def poll(self, now_ns: int) -> None:
        """Take in what was answered and ask whom it is time to ask."""
        while self._answers:
            self._take(*self._answers.popleft())
        if now_ns >= self._next_look:
            self._next_look = now_ns + _LOOK_PERIOD_NS
            self._doubt(now_ns)
        if now_ns >= self.due_ns:
            for peer in self._peers.values():
                if now_ns >= peer.next_ping and not peer.same_clock and peer.heard:
                    peer.pinged(now_ns)
                    self._ping(peer.source)
            self._plan(now_ns)

    def _meet(self, source: str, boot: int) -> int:
        """Somebody new: ask after this step."""
        if source:
            if len(self._peers) >= _MAX_PEERS:
                # Names made up by the dozen must not push out those whose clocks are known.
                unknown = (key for key, peer in self._peers.items() if peer.offset == UNKNOWN)
                del self._peers[next(unknown, next(iter(self._peers)))]
            if len(self._newest) >= _MAX_PEERS:
                del self._newest[next(iter(self._newest))]
            self._peers[source, boot] = self._newest[source] = _Peer(source, 0)
            self.due_ns = 0
        return UNKNOWN

    def _plan(self, now_ns: int) -> None:
        due = (peer.next_ping for peer in self._peers.values() if not peer.same_clock)
        # A silent peer is only asked once it is heard again; looking ten times a second will do.
        self.due_ns = min((max(at, now_ns + _FIRST_PERIOD_NS) for at in due), default=NEVER)

    def _doubt(self, now_ns: int) -> None:
        """What arrives too old may be the work of a clock that was set: ask at once."""
        stale = self._context.inbox.stale if self._context is not None else 0
        if stale > self._stale:
            for peer in self._peers.values():
                peer.next_ping = now_ns
            self.due_ns = min(self.due_ns, now_ns)
        self._stale = stale

    def _ping(self, source: str) -> None:
        """Ask; the answer is noted by the transport's thread and taken in by ours."""
        context = self._context
        if context is None:
            return
        note, clock = self._answers.append, self._clock
        querier = self._queriers.get(source)
        try:
            if querier is None:
                if len(self._queriers) >= _MAX_PEERS:
                    self._queriers.pop(next(iter(self._queriers))).undeclare()
                querier = self._queriers[source] = context.session.declare_querier(
                    f"{context.robot}/clock/{source}",
                    timeout=_TIMEOUT_S,
                    consolidation=zenoh.ConsolidationMode.NONE,
                    priority=zenoh.Priority.REAL_TIME,
                    congestion_control=zenoh.CongestionControl.DROP,
                    express=True,
                )
            asked = clock()

            def heard(reply: Any) -> None:
                arrival = clock()
                if reply.ok is not None:
                    note((source, asked, arrival, reply.ok.payload.to_bytes()))

            # Directly in the transport's thread: a thread for each answer would cost more.
            querier.get(zenoh.handlers.Callback(heard, indirect=False))
        except zenoh.ZError as error:
            _log.debug("cannot ask %s for its clock: %s", source, error)

    def _take(self, source: str, asked: int, heard: int, payload: bytes) -> None:
        answer = unpack_answer(payload)
        peer = None if answer is None else self._peers.get((source, answer.boot))
        if answer is None or peer is None:
            return
        if answer.clock == self._identity:
            peer.same_clock, peer.offset = True, 0
            return
        steps = peer.estimator.steps
        peer.estimator.add(Exchange(asked, answer.received, answer.answered, heard))
        estimate = peer.estimator.estimate(heard)
        if estimate is None:
            return
        if peer.offset == UNKNOWN:
            _log.info("the clock of %s is behind this one's by %s", source, _words(estimate))
        elif peer.estimator.steps > steps:
            _log.warning("the clock of %s was set: now behind by %s", source, _words(estimate))
        peer.offset = estimate.offset


def _words(estimate: Offset) -> str:
    return f"{1e-6 * estimate.offset:.3f} ± {1e-6 * estimate.error:.3f} ms"
