"""Loss and return of peers by heartbeats: the decision, the component, and real processes."""

import itertools
import logging
import signal
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import zenoh

from common.inbox.inbox import Inbox
from common.runtime.live.clock_sync import ClockSync
from common.runtime.live.components import RunnerContext
from common.runtime.live.heartbeats import Heartbeats, PeerLiveness
from common.schemas import Header, Heartbeat, Message, PeerHealth
from common.topics import HEARTBEAT, Topic
from common.transport.session import wire_encoding
from common.wire.codec import encode, schema_tag
from tests.common.runtime.test_live import Stack

MS = 1_000_000
TIMEOUT = 100 * MS


def test_a_loss_is_found_within_the_timeout_and_only_then() -> None:
    liveness = PeerLiveness()
    assert not liveness.check(10**12, False)  # never heard: not dead either
    assert liveness.receive(0, TIMEOUT)
    assert liveness.deadline_ns < TIMEOUT
    assert not liveness.check(liveness.deadline_ns - 1, False)
    # One beat may be missed: they come every 40 ms.
    assert liveness.deadline_ns > 80 * MS
    assert liveness.check(liveness.deadline_ns, False)
    assert (liveness.alive, liveness.losses) == (False, 1)
    assert not liveness.check(10 * TIMEOUT, False)  # found once
    assert liveness.receive(11 * TIMEOUT, TIMEOUT)
    assert not liveness.receive(11 * TIMEOUT + 1, TIMEOUT)
    assert liveness.check(20 * TIMEOUT, False)
    assert liveness.losses == 2


def test_a_longer_timeout_is_respected() -> None:
    liveness = PeerLiveness()
    liveness.receive(0, 5 * TIMEOUT)
    assert not liveness.check(4 * TIMEOUT, False)
    assert liveness.check(5 * TIMEOUT, False)


def test_a_watcher_that_stood_still_waits_before_it_decides() -> None:
    liveness = PeerLiveness()
    liveness.receive(0, TIMEOUT)
    assert not liveness.check(150 * MS, True)
    assert not liveness.check(151 * MS, False)
    liveness.receive(149 * MS, TIMEOUT)  # was only waiting to be heard
    assert not liveness.check(175 * MS, False)
    # One that stands still all the time judges all the same.
    assert not liveness.check(300 * MS, True)
    assert liveness.check(450 * MS, True)


class FakeSession:
    """Hands out what subscribes, so that a test can play the transport."""

    def __init__(self) -> None:
        self.listeners: dict[str, Callable[[Any], None]] = {}

    def declare_subscriber(self, key: str, listener: Callable[[Any], None]) -> object:
        self.listeners[key] = listener
        return object()


class Sample:
    """What the transport gives."""

    key_expr = "draco3/heartbeat/sim"

    def __init__(self, payload: bytes) -> None:
        self.payload = self
        self.encoding = wire_encoding(schema_tag(Heartbeat))
        self._bytes = payload

    def to_bytes(self) -> bytes:
        return self._bytes


class Bench:
    """An component under test that hears from "sim"."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, period_ms: int = 10) -> None:
        self.now = 10_000 * MS
        monkeypatch.setattr("common.runtime.live.heartbeats.time.monotonic_ns", lambda: self.now)
        self.sent: list[tuple[int, Heartbeat]] = []
        self.session = FakeSession()
        self.clocks = ClockSync()
        self.clocks.offset_of(Header(source="sim", boot=5))
        self.component = Heartbeats(self.clocks, lambda: 7, period_ms * MS, 0.25)
        self.component.open(
            RunnerContext(
                self.session, "draco3", "wbc", 1, Inbox(()), self._send, lambda _topic: True
            )
        )

    def _send(self, topic: Topic[Any], message: Message) -> None:
        assert topic is HEARTBEAT
        assert isinstance(message, Heartbeat)
        self.sent.append((self.now, message))

    def beat(self, payload: bytes | None = None) -> None:
        good = encode(Heartbeat(steps=1, timeout=0.1), Header(source="sim", boot=5))
        self.session.listeners["draco3/heartbeat/sim"](Sample(payload or good))

    def run(self, ms: int, step_ms: int = 10, beats: int = 0) -> None:
        """Poll every ``step_ms``, with a heartbeat from the peer every ``beats`` ms."""
        for at in range(0, ms, step_ms):
            if beats and at % beats == 0:
                self.beat()
            self.component.poll(self.now)
            self.now += step_ms * MS

    def peer(self) -> PeerHealth:
        (peer,) = self.component.report()["peers"]
        assert isinstance(peer, PeerHealth)
        return peer


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    return Bench(monkeypatch)


@pytest.mark.parametrize("period_ms", [1, 5, 10, 50])
def test_beats_come_at_their_rate_between_the_steps_too(
    monkeypatch: pytest.MonkeyPatch, period_ms: int
) -> None:
    bench = Bench(monkeypatch, period_ms)
    end = bench.now + 2000 * MS
    step_due = bench.now
    while bench.now < end:
        bench.component.poll(bench.now)
        if bench.now >= step_due:
            step_due += period_ms * MS
        bench.now = min(step_due, max(bench.component.due_ns, bench.now + MS))
    times = [at for at, _ in bench.sent]
    assert len(times) == pytest.approx(50, abs=2)
    assert max(b - a for a, b in itertools.pairwise(times)) <= 50 * MS
    assert bench.sent[0][1].timeout == 0.25
    assert bench.sent[0][1].steps == 7


def test_loss_and_return_are_logged_once_each(bench: Bench, caplog: Any) -> None:
    caplog.set_level(logging.WARNING)
    bench.run(500)
    assert bench.peer().silent == -1.0
    assert not bench.peer().alive
    bench.run(500, beats=40)
    assert bench.peer().alive
    assert caplog.messages == []
    bench.run(700)
    assert not bench.peer().alive
    bench.run(500, beats=40)
    peer = bench.peer()
    assert (peer.alive, peer.losses) == (True, 1)
    assert 0.0 <= peer.silent < 0.1
    first, second = caplog.messages
    assert first.startswith("no sign of life from sim for 0.1")
    assert second.startswith("sim is alive again after 0.7")


def test_the_component_is_due_in_time_to_find_a_loss(bench: Bench) -> None:
    bench.run(100)
    bench.run(200, beats=40)
    last = bench.now
    bench.beat()
    bench.component.poll(bench.now)
    while bench.peer().alive:
        bench.now = max(bench.component.due_ns, bench.now + MS // 10)
        bench.component.poll(bench.now)
    assert bench.now - last <= 100 * MS


def test_an_unreadable_beat_is_a_beat(bench: Bench) -> None:
    bench.run(100)
    bench.beat(b"\xc1")
    bench.run(3000)
    assert bench.peer().alive


def test_a_name_that_is_no_key_does_not_end_the_loop(bench: Bench) -> None:
    bench.clocks.offset_of(Header(source="operator #1", boot=6))
    bench.session.declare_subscriber = refusing(bench.session.declare_subscriber)  # type: ignore[method-assign]
    bench.run(100)
    bench.run(200, beats=40)
    peers = {peer.source: peer.alive for peer in bench.component.report()["peers"]}
    assert peers == {"sim": True, "operator #1": False}


def refusing(declare: Callable[..., object]) -> Callable[..., object]:
    """Refuse keys that are none, as the transport does."""

    def checked(key: str, listener: Callable[[Any], None]) -> object:
        zenoh.KeyExpr(key)
        return declare(key, listener)

    return checked


@pytest.fixture
def stack() -> Iterator[Stack]:
    running = Stack()
    yield running
    running.stop()


@pytest.mark.parametrize("how", ["pause", "kill"])
def test_a_dead_process_is_noticed_and_found_again(stack: Stack, how: str) -> None:
    processes = {n: stack.start(n, k) for n, k in {"sim": "plant", "wbc": "controller"}.items()}

    def seen() -> PeerHealth | None:
        health = stack.health("wbc")
        return health.peers[0] if health is not None and health.peers else None

    def alive() -> bool:
        peer = seen()
        return peer is not None and peer.source == "sim" and peer.alive

    def dead() -> bool:
        peer = seen()
        return peer is not None and not peer.alive

    assert stack.until(alive)
    before = seen()
    assert before is not None
    processes["sim"].send_signal(signal.SIGSTOP if how == "pause" else signal.SIGKILL)
    assert stack.until(dead)
    after = seen()
    assert after is not None
    assert after.losses >= before.losses + 1
    if how == "pause":
        processes["sim"].send_signal(signal.SIGCONT)
    else:
        processes["sim"].wait()
        stack.start("sim", "plant")
    assert stack.until(alive)
    processes["wbc"].send_signal(signal.SIGTERM)
    _, errors = processes["wbc"].communicate(timeout=30)
    assert "no sign of life from sim" in errors
    assert "sim is alive again" in errors
