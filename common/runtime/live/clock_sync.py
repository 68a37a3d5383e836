"""Estimate the offsets between this service's clock and those of its inputs' senders.

Every live service answers queries on :data:`common.queries.CLOCK` with the times at which it
received and answered them, its boot id and the identity of its clock. Every live service asks the
senders of its inputs: at once when their first message comes, a few times in short order, then
once a second as long as messages come. Processes with the same clock (same kernel, same time
namespace) have an offset of exactly 0 and are not asked again. Wall clocks play no part.
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

from common import queries
from common.journal.tables import UNKNOWN
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
_STALE_CHECK_PERIOD_NS = 250_000_000
_TIMEOUT_S = 5.0
_MAX_PEERS = 64


def clock_identity() -> bytes:
    """Return 16 bytes that identify the monotonic clock of this process; the same if it is shared.

    They are made of the kernel's boot id and the time namespace. Without a boot id no two
    processes are taken to share a clock.
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
    """Answer to a clock query; times of the answering clock [ns]."""

    clock: bytes
    boot: int
    received: int
    answered: int


def pack_answer(answer: Answer) -> bytes:
    """Encode an answer."""
    return _ANSWER.pack(_MAGIC, *answer)


def unpack_answer(payload: bytes) -> Answer | None:
    """Decode an answer; None if the bytes are none."""
    if len(payload) != _ANSWER.size:
        return None
    magic, *fields = _ANSWER.unpack(payload)
    return Answer(*fields) if magic == _MAGIC else None


class _Peer:
    """One run of one source."""

    def __init__(self, source: str, now_ns: int) -> None:
        self.source = source
        self.offset = UNKNOWN
        self.active = True
        """Whether a message came since the last ping."""
        self.same_clock = False
        self.pings = 0
        self.next_ping = now_ns
        self.estimator = OffsetEstimator()

    def schedule_ping(self, now_ns: int) -> None:
        """Schedule the ping after the one sent now; it is sent only if messages come."""
        self.pings += 1
        self.active = False
        period = _FIRST_PERIOD_NS if self.pings < _FIRST_PINGS else _PERIOD_NS
        self.next_ping = now_ns + period

    def estimate(self, now_ns: int) -> Offset | None:
        return Offset(0, 0) if self.same_clock else self.estimator.estimate(now_ns)


class ClockSync(Component):
    """Answers pings, and pings the senders of the service's inputs."""

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
        self._next_stale_check = 0
        self._stale = 0

    @property
    def sources(self) -> tuple[str, ...]:
        """Senders of the messages received so far."""
        return tuple(self._newest)

    def offset_of(self, header: Header) -> int:
        """Return this clock minus that of a message's sender [ns]; UNKNOWN if not known (yet)."""
        peer = self._peers.get((header.source, header.boot))
        if peer is None:
            self._add_peer(header.source, header.boot)
            return UNKNOWN
        peer.active = True
        return peer.offset

    def known(self, source: str) -> Offset | None:
        """Return the estimate for the newest run of a source [ns]; None if there is none."""
        peer = self._newest.get(source)
        return None if peer is None else peer.estimate(self._clock())

    def open(self, context: RunnerContext) -> None:
        """Start answering."""
        self._context = context
        clock, identity, boot = self._clock, self._identity, context.boot

        def answer(query: Any) -> None:
            received = clock()
            payload = pack_answer(Answer(identity, boot, received, clock()))
            with contextlib.suppress(zenoh.ZError):  # the asking or this session is closing
                query.reply(query.key_expr, payload, express=True)

        key = queries.CLOCK.key(context.robot, context.service)
        self._queryable = context.session.declare_queryable(key, answer)

    def poll(self, now_ns: int) -> None:
        """Process the answers that came and send the pings that are due."""
        while self._answers:
            self._process(*self._answers.popleft())
        if now_ns >= self._next_stale_check:
            self._next_stale_check = now_ns + _STALE_CHECK_PERIOD_NS
            self._check_stale(now_ns)
        if now_ns >= self.due_ns:
            for peer in self._peers.values():
                if now_ns >= peer.next_ping and not peer.same_clock and peer.active:
                    peer.schedule_ping(now_ns)
                    self._ping(peer.source)
            self._schedule(now_ns)

    def _add_peer(self, source: str, boot: int) -> None:
        """Add a new sender and have it pinged after this step."""
        if not source:
            return
        if len(self._peers) >= _MAX_PEERS:
            # Dozens of made-up names must not push out peers whose clocks are known.
            unknown = (key for key, peer in self._peers.items() if peer.offset == UNKNOWN)
            del self._peers[next(unknown, next(iter(self._peers)))]
        if len(self._newest) >= _MAX_PEERS:
            del self._newest[next(iter(self._newest))]
        self._peers[source, boot] = self._newest[source] = _Peer(source, 0)
        self.due_ns = 0

    def _schedule(self, now_ns: int) -> None:
        due = (peer.next_ping for peer in self._peers.values() if not peer.same_clock)
        # A silent peer is pinged once a message comes again; ten checks a second will do for that.
        self.due_ns = min((max(at, now_ns + _FIRST_PERIOD_NS) for at in due), default=NEVER)

    def _check_stale(self, now_ns: int) -> None:
        """Ping at once if messages arrive too old: a clock may have been set."""
        stale = self._context.inbox.stale if self._context is not None else 0
        if stale > self._stale:
            for peer in self._peers.values():
                peer.next_ping = now_ns
            self.due_ns = min(self.due_ns, now_ns)
        self._stale = stale

    def _ping(self, source: str) -> None:
        """Send a ping; the transport's thread queues the answer for the service's thread."""
        context = self._context
        if context is None:
            return
        queue_answer, clock = self._answers.append, self._clock
        querier = self._queriers.get(source)
        try:
            if querier is None:
                if len(self._queriers) >= _MAX_PEERS:
                    self._queriers.pop(next(iter(self._queriers))).undeclare()
                querier = self._queriers[source] = context.session.declare_querier(
                    queries.CLOCK.key(context.robot, source),
                    timeout=_TIMEOUT_S,
                    consolidation=zenoh.ConsolidationMode.NONE,
                    priority=zenoh.Priority.REAL_TIME,
                    congestion_control=zenoh.CongestionControl.DROP,
                    express=True,
                )
            asked = clock()

            def receive(reply: Any) -> None:
                arrival = clock()
                if reply.ok is not None:
                    queue_answer((source, asked, arrival, reply.ok.payload.to_bytes()))

            # Directly in the transport's thread: a thread for each answer would cost more.
            querier.get(zenoh.handlers.Callback(receive, indirect=False))
        except zenoh.ZError as error:
            _log.debug("cannot ask %s for its clock: %s", source, error)

    def _process(self, source: str, asked: int, returned: int, payload: bytes) -> None:
        answer = unpack_answer(payload)
        peer = None if answer is None else self._peers.get((source, answer.boot))
        if answer is None or peer is None:
            return
        if answer.clock == self._identity:
            peer.same_clock, peer.offset = True, 0
            return
        steps = peer.estimator.steps
        peer.estimator.add(Exchange(asked, answer.received, answer.answered, returned))
        estimate = peer.estimator.estimate(returned)
        if estimate is None:
            return
        if peer.offset == UNKNOWN:
            _log.info("the clock of %s is behind this one's by %s", source, _format(estimate))
        elif peer.estimator.steps > steps:
            _log.warning("the clock of %s was set: now behind by %s", source, _format(estimate))
        peer.offset = estimate.offset


def _format(estimate: Offset) -> str:
    return f"{1e-6 * estimate.offset:.3f} ± {1e-6 * estimate.error:.3f} ms"
