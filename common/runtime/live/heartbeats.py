"""Send a service's heartbeat, and detect that the loop of another service has stopped.

The heartbeat is sent by the loop itself, so it stops with the loop: readers notice a service that
is killed, paused, hung in a step or cut off within its heartbeat timeout, 0.1 s as a rule, and long
before the transport gives a link up. A service with long steps announces a longer timeout
(:attr:`common.runtime.service.Service.heartbeat_timeout_s`).
"""

import logging
import time
from collections.abc import Callable
from typing import Any

import zenoh

from common.errors import SchemaError
from common.runtime.live.clock_sync import ClockSync
from common.runtime.live.components import NEVER, Component, RunnerContext
from common.schemas import Heartbeat, PeerHealth
from common.topics import HEARTBEAT
from common.transport.keys import is_wildcard, key_of
from common.transport.session import tag_of
from common.wire.codec import decode

_log = logging.getLogger(__name__)

_MS = 1_000_000
_PERIOD_NS = round(1e9 / HEARTBEAT.rate)
_EARLY_NS = 8 * _MS
"""Margin: a loss is reported this long before the timeout."""
_STILL_NS = 20 * _MS
"""A watcher that was not polled for this long may not have received what was sent; it waits as
long again before it reports a loss."""
_RETRY_NS = 50 * _MS
"""Between checks for the next heartbeat of a lost peer."""
_MAX_PEERS = 32


class PeerLiveness:
    """Decides whether one peer is alive, from the times of its heartbeats. Pure.

    Attributes:
        last_ns: when the last heartbeat arrived [ns]; -1 before the first.
        alive: whether heartbeats arrive.
        losses: times the peer was lost.
    """

    def __init__(self) -> None:
        """Start before the first heartbeat."""
        self.last_ns = -1
        self.alive = False
        self.losses = 0
        self._timeout_ns = NEVER
        self._confirming_since_ns: int | None = None

    @property
    def deadline_ns(self) -> int:
        """When the peer is lost without another heartbeat [ns]."""
        return self.last_ns + self._timeout_ns - _EARLY_NS if self.alive else NEVER

    def receive(self, arrival_ns: int, timeout_ns: int) -> bool:
        """Note the newest heartbeat; returns whether the peer was not alive before it."""
        self.last_ns = arrival_ns
        self._timeout_ns = timeout_ns
        self._confirming_since_ns = None
        appeared = not self.alive
        self.alive = True
        return appeared

    def check(self, now_ns: int, stood_still: bool) -> bool:
        """Return whether the peer is found lost now.

        Args:
            now_ns: every heartbeat that arrived until then was received, unless
            stood_still: the watcher itself did not run; then the silence has to be confirmed.
        """
        if now_ns < self.deadline_ns:
            return False
        if self._confirming_since_ns is None and stood_still:
            self._confirming_since_ns = now_ns
        since_ns = self._confirming_since_ns
        if since_ns is not None and now_ns < since_ns + _STILL_NS:
            return False
        self.alive = False
        self.losses += 1
        return True


class _Peer:
    """A source, its liveness and its newest heartbeat as the transport's thread left it."""

    def __init__(self) -> None:
        self.liveness = PeerLiveness()
        self.subscriber: Any = None
        self.newest: tuple[int, bytes, Any] | None = None
        """Arrival [ns], payload and encoding."""


class Heartbeats(Component):
    """Sends heartbeats, and watches those of the sources of the service's inputs."""

    writes = (HEARTBEAT,)

    def __init__(
        self, clocks: ClockSync, steps: Callable[[], int], period_ns: int, timeout_s: float
    ) -> None:
        """Prepare.

        Args:
            clocks: knows the sources of inputs and the offsets of their clocks.
            steps: returns how many steps the service has made.
            period_ns: between its steps; a heartbeat is sent right after a step where that is soon
                enough, so that none delays the next step.
            timeout_s: silence after which readers may take the service for lost [s].
        """
        self._clocks = clocks
        self._steps = steps
        self._timeout_s = timeout_s
        self._lead_ns = period_ns if period_ns <= _PERIOD_NS // 2 else 0
        self._peers: dict[str, _Peer] = {}
        self._context: RunnerContext | None = None
        self._send_due = self._check_due = self._opened_ns = 0
        self._polled_ns = 0

    def open(self, context: RunnerContext) -> None:
        """Remember where to send, and since when."""
        self._context, self._opened_ns = context, time.monotonic_ns()

    def poll(self, now_ns: int) -> None:
        """Send a heartbeat and check the peers, if it is time."""
        if now_ns >= self._send_due - self._lead_ns:
            self._send(now_ns)
        if now_ns >= self._check_due:
            self._watch_new_sources()
            self._check(now_ns, now_ns - self._polled_ns > _STILL_NS)
        self._polled_ns = now_ns
        self.due_ns = min(self._send_due, self._check_due)

    def close(self) -> None:
        """Receive no more heartbeats."""
        for peer in self._peers.values():
            if peer.subscriber is not None:
                peer.subscriber.undeclare()

    def report(self) -> dict[str, Any]:
        """Return every source of inputs as seen from here."""
        now = self._polled_ns
        return {"peers": [self._health_of(name, peer, now) for name, peer in self._peers.items()]}

    def _send(self, now_ns: int) -> None:
        self._send_due = max(self._send_due, now_ns - self._lead_ns) + _PERIOD_NS
        if self._context is not None:
            uptime = 1e-9 * max(0, now_ns - self._opened_ns)
            message = Heartbeat(steps=self._steps(), timeout=self._timeout_s, uptime=uptime)
            self._context.send(HEARTBEAT, message)

    def _watch_new_sources(self) -> None:
        """Subscribe to the heartbeats of sources that appeared."""
        context = self._context
        for source in self._clocks.sources:
            if source in self._peers or context is None or len(self._peers) >= _MAX_PEERS:
                continue
            peer = self._peers[source] = _Peer()
            key = key_of(context.robot, HEARTBEAT, source)
            try:
                peer.subscriber = context.session.declare_subscriber(key, _receiver(peer))
            except zenoh.ZError as error:  # a source whose name is no key sends no heartbeats
                _log.warning("cannot subscribe to the heartbeat of %r: %s", source, error)

    def _check(self, now_ns: int, stood_still: bool) -> None:
        """Process the newest heartbeats and find lost peers."""
        due = now_ns + _RETRY_NS
        for source, peer in self._peers.items():
            newest, liveness = peer.newest, peer.liveness
            if newest is not None and newest[0] != liveness.last_ns:
                silent_ns = newest[0] - liveness.last_ns
                if liveness.receive(newest[0], _timeout_ns(newest)) and liveness.losses:
                    _log.warning("%s is alive again after %.2f s", source, 1e-9 * silent_ns)
            if liveness.check(now_ns, stood_still):
                _log.warning(
                    "no sign of life from %s for %.3f s: stopped, hung or cut off",
                    source,
                    1e-9 * (now_ns - liveness.last_ns),
                )
            due = min(due, max(liveness.deadline_ns, now_ns + _MS))
        self._check_due = due

    def _health_of(self, source: str, peer: _Peer, now_ns: int) -> PeerHealth:
        liveness = peer.liveness
        last_ns = liveness.last_ns if peer.newest is None else peer.newest[0]
        offset = self._clocks.known(source)
        return PeerHealth(
            source=source[:64],
            alive=liveness.alive,
            silent=1e-9 * max(0, now_ns - last_ns) if last_ns >= 0 else -1.0,
            losses=liveness.losses,
            clock_offset=1e-9 * offset.offset if offset is not None else 0.0,
            clock_error=1e-9 * offset.error if offset is not None else -1.0,
        )


def _receiver(peer: _Peer) -> Callable[[Any], None]:
    """Return a callback that keeps the newest heartbeat and does nothing else."""
    clock = time.monotonic_ns

    def receive(sample: Any) -> None:
        if is_wildcard(str(sample.key_expr)):
            return
        peer.newest = (clock(), sample.payload.to_bytes(), sample.encoding)

    return receive


def _timeout_ns(newest: tuple[int, bytes, Any]) -> int:
    """Return the timeout that a heartbeat announces; the longest there is if it is unreadable."""
    try:
        message = decode(newest[1], Heartbeat, tag_of(newest[2]) or None)
    except SchemaError:
        return 10_000_000_000
    return round(1e9 * message.timeout)
