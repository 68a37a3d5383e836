"""Says that this service's loop is alive, and notices when that of another is not.

The beat is sent by the loop itself, so that it stops with it: a service that is killed, paused,
hung in a step or cut off is missed by those who read from it within its promise, 0.1 s as a rule,
and long before the transport gives a link up. A service whose steps take long promises less
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
from common.transport.keys import key_of
from common.transport.session import tag_of
from common.wire.codec import decode

_log = logging.getLogger(__name__)

_MS = 1_000_000
_PERIOD_NS = round(1e9 / HEARTBEAT.rate)
_EARLY_NS = 8 * _MS
"""Silence is judged this much before the promise is over, so that it is told within it."""
_STILL_NS = 20 * _MS
"""A watcher that was not tended for so long may not have heard what was sent; it listens again
for as long before it judges."""
_RETRY_NS = 50 * _MS
"""Between looks for a dead peer's first beat."""
_MAX_PEERS = 32


class PeerLiveness:
    """Whether one peer is alive, judged from the times of its beats. Pure."""

    def __init__(self) -> None:
        """Nothing was heard yet."""
        self.last_ns = -1
        self.alive = False
        self.deaths = 0
        self._promise_ns = NEVER
        self._doubted_ns: int | None = None

    @property
    def deadline_ns(self) -> int:
        """When silence will mean death [ns]."""
        return self.last_ns + self._promise_ns - _EARLY_NS if self.alive else NEVER

    def hear(self, arrival_ns: int, promise_ns: int) -> bool:
        """Note the newest beat; whether it brought the peer (back) to life."""
        self.last_ns = arrival_ns
        self._promise_ns = promise_ns
        self._doubted_ns = None
        born = not self.alive
        self.alive = True
        return born

    def judge(self, now_ns: int, stood_still: bool) -> bool:
        """Return whether the peer is found dead at ``now_ns``.

        If the watcher ``stood_still``, beats may be waiting to be heard: silence is confirmed then.
        """
        if now_ns < self.deadline_ns:
            return False
        if self._doubted_ns is None and stood_still:
            self._doubted_ns = now_ns
        if self._doubted_ns is not None and now_ns < self._doubted_ns + _STILL_NS:
            return False
        self.alive = False
        self.deaths += 1
        return True


class _Peer:
    """A source, its pulse and the newest beat as the transport's thread left it."""

    def __init__(self) -> None:
        self.pulse = PeerLiveness()
        self.subscriber: Any = None
        self.beat: tuple[int, bytes, Any] | None = None


class Heartbeats(Component):
    """Beats, and listens to the beats of those whose messages the service takes in."""

    writes = (HEARTBEAT,)

    def __init__(
        self, clocks: ClockSync, steps: Callable[[], int], period_ns: int, promise_s: float
    ) -> None:
        """Prepare.

        Args:
            clocks: knows who is heard, and how far their clocks are off.
            steps: tells how many steps the service has made.
            period_ns: between its steps; a beat goes out right after a step where that is soon
                enough, so that none delays the next.
            promise_s: silence that means death [s].
        """
        self._clocks = clocks
        self._steps = steps
        self._promise_s = promise_s
        self._lead_ns = period_ns if period_ns <= _PERIOD_NS // 2 else 0
        self._peers: dict[str, _Peer] = {}
        self._context: RunnerContext | None = None
        self._beat_due = self._look_due = 0
        self._tended_ns = 0

    def open(self, context: RunnerContext) -> None:
        """Remember where to send."""
        self._context = context

    def poll(self, now_ns: int) -> None:
        """Beat and look after the others, if it is time."""
        if now_ns >= self._beat_due - self._lead_ns:
            self._beat(now_ns)
        if now_ns >= self._look_due:
            self._meet()
            self._look(now_ns, now_ns - self._tended_ns > _STILL_NS)
        self._tended_ns = now_ns
        self.due_ns = min(self._beat_due, self._look_due)

    def report(self) -> dict[str, Any]:
        """Every source that was heard, as seen from here."""
        now = self._tended_ns
        return {"peers": [self._health_of(name, peer, now) for name, peer in self._peers.items()]}

    def _beat(self, now_ns: int) -> None:
        self._beat_due = max(self._beat_due, now_ns - self._lead_ns) + _PERIOD_NS
        if self._context is not None:
            beat = Heartbeat(steps=self._steps(), promise=self._promise_s)
            self._context.send(HEARTBEAT, beat)

    def _meet(self) -> None:
        """Listen to whoever is heard for the first time."""
        context = self._context
        for source in self._clocks.sources:
            if source in self._peers or context is None or len(self._peers) >= _MAX_PEERS:
                continue
            peer = self._peers[source] = _Peer()
            key = key_of(context.robot, HEARTBEAT, source)
            try:
                peer.subscriber = context.session.declare_subscriber(key, _listener(peer))
            except zenoh.ZError as error:  # whoever names itself so sends no beats either
                _log.warning("cannot listen to the heartbeat of %r: %s", source, error)

    def _look(self, now_ns: int, stood_still: bool) -> None:
        """Take in the newest beats and find the dead."""
        due = now_ns + _RETRY_NS
        for source, peer in self._peers.items():
            beat, pulse = peer.beat, peer.pulse
            if beat is not None and beat[0] != pulse.last_ns:
                silent_ns = beat[0] - pulse.last_ns
                if pulse.hear(beat[0], _promise_ns(beat)) and pulse.deaths:
                    _log.warning("%s is alive again after %.2f s", source, 1e-9 * silent_ns)
            if pulse.judge(now_ns, stood_still):
                _log.warning(
                    "no sign of life from %s for %.3f s: stopped, hung or cut off",
                    source,
                    1e-9 * (now_ns - pulse.last_ns),
                )
            due = min(due, max(pulse.deadline_ns, now_ns + _MS))
        self._look_due = due

    def _health_of(self, source: str, peer: _Peer, now_ns: int) -> PeerHealth:
        pulse = peer.pulse
        last_ns = pulse.last_ns if peer.beat is None else peer.beat[0]
        offset = self._clocks.known(source)
        return PeerHealth(
            source=source[:64],
            alive=pulse.alive,
            silent=1e-9 * max(0, now_ns - last_ns) if last_ns >= 0 else -1.0,
            deaths=pulse.deaths,
            clock_offset=1e-9 * offset.offset if offset is not None else 0.0,
            clock_error=1e-9 * offset.error if offset is not None else -1.0,
        )


def _listener(peer: _Peer) -> Callable[[Any], None]:
    """Return a callback that keeps the newest beat and does nothing else."""
    clock = time.monotonic_ns

    def listen(sample: Any) -> None:
        peer.beat = (clock(), sample.payload.to_bytes(), sample.encoding)

    return listen


def _promise_ns(beat: tuple[int, bytes, Any]) -> int:
    """What a beat promises; what cannot be read promises as little as a beat can."""
    try:
        message = decode(beat[1], Heartbeat, tag_of(beat[2]) or None)
    except SchemaError:
        return 10_000_000_000
    return round(1e9 * message.promise)
