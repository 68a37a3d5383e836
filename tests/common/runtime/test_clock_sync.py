"""Clock offsets: the component alone, and real processes whose clocks are off or are set."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from common.inbox.inbox import Inbox
from common.journal.tables import UNKNOWN
from common.runtime.live.clock_sync import (
    Answer,
    ClockSync,
    clock_identity,
    pack_answer,
    unpack_answer,
)
from common.runtime.live.components import RunnerContext
from common.schemas import Header, PeerHealth
from tests.common.runtime.test_live import ROOT, Stack
from verification.faults.support import clock_shim

MS = 1_000_000
SECOND = 1_000_000_000


class FakeNetwork:
    """Plays session, querier and the other host, whose clock is behind by ``offset`` [ns]."""

    def __init__(self) -> None:
        self.now = 500 * SECOND
        self.offset = 200 * MS
        self.boot = 5
        self.clock_name = b"c" * 16
        self.way = 300_000
        self.answering = True
        self.reply: bytes | None = None
        self.asked: list[int] = []

    def declare_queryable(self, _key: str, _answer: Callable[[Any], None]) -> object:
        return object()

    def declare_querier(self, key: str, **_options: Any) -> "FakeNetwork":
        assert key == "draco3/clock/sim"
        return self

    def undeclare(self) -> None:
        return

    def get(self, handler: Any) -> None:
        self.asked.append(self.now)
        if not self.answering:
            return
        self.now += self.way
        there = self.now - self.offset
        self.now += self.way
        good = pack_answer(Answer(self.clock_name, self.boot, there, there))
        handler.callback(Reply(good if self.reply is None else self.reply))


class Reply:
    """A good reply; the transport's has the same attributes."""

    def __init__(self, payload: bytes) -> None:
        self.ok = self
        self.payload = self
        self._bytes = payload

    def to_bytes(self) -> bytes:
        return self._bytes


class Handler:
    """Stands in for the transport's, which does not show what it wraps."""

    def __init__(self, callback: Callable[[Any], None], indirect: bool) -> None:
        assert not indirect
        self.callback = callback


class Bench:
    """An component that inputs in 100 messages a second from "sim"."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr("common.runtime.live.clock_sync.zenoh.handlers.Callback", Handler)
        self.net = FakeNetwork()
        self.clocks = ClockSync(lambda: self.net.now, b"h" * 16)
        self.inbox = Inbox(())
        self.clocks.open(
            RunnerContext(
                self.net, "draco3", "wbc", 1, self.inbox, lambda *_: None, lambda _topic: True
            )
        )

    def run(self, seconds: float, talking: bool = True) -> None:
        for _ in range(round(100 * seconds)):
            if talking:
                self.offset()
            self.clocks.poll(self.net.now)
            self.net.now += 10 * MS

    def offset(self) -> int:
        return self.clocks.offset_of(Header(source="sim", boot=self.net.boot))

    def error(self) -> int:
        return abs(self.offset() - self.net.offset)


@pytest.fixture
def bench(monkeypatch: pytest.MonkeyPatch) -> Bench:
    return Bench(monkeypatch)


def test_an_unknown_source_is_asked_at_once_and_then_once_a_second(bench: Bench) -> None:
    assert bench.offset() == UNKNOWN
    bench.clocks.poll(bench.net.now)
    assert len(bench.net.asked) == 1
    bench.run(0.02)
    assert bench.error() <= bench.net.way + 1
    bench.run(10)
    assert 10 <= len(bench.net.asked) <= 15
    known = bench.clocks.known("sim")
    assert known is not None
    assert bench.error() <= known.error


def test_who_shares_the_clock_has_offset_zero_and_is_asked_once(bench: Bench) -> None:
    bench.net.clock_name = b"h" * 16
    bench.run(5)
    assert bench.offset() == 0
    assert bench.clocks.known("sim") == (0, 0)
    assert len(bench.net.asked) == 1


def test_without_an_answer_the_offset_stays_unknown(bench: Bench) -> None:
    bench.net.answering = False
    bench.run(5)
    assert bench.offset() == UNKNOWN
    assert bench.clocks.known("sim") is None
    bench.net.answering = True
    bench.run(2)
    assert bench.error() <= bench.net.way + 1


def test_a_restart_makes_the_offset_unknown_until_asked_again(bench: Bench) -> None:
    bench.run(3)
    bench.net.boot, bench.net.offset = 6, -7 * SECOND
    assert bench.offset() == UNKNOWN
    bench.run(0.1)
    assert bench.error() <= bench.net.way + 1
    # A message of the earlier run that is still under way has the earlier run's clock.
    assert abs(bench.clocks.offset_of(Header(source="sim", boot=5)) - 200 * MS) <= MS


@pytest.mark.parametrize("step", [150 * MS, -SECOND])
def test_a_clock_that_is_set_is_followed_within_two_pings(bench: Bench, step: int) -> None:
    bench.run(20)
    bench.net.offset += step
    before = len(bench.net.asked)
    bench.run(2)
    assert len(bench.net.asked) - before <= 2
    assert bench.error() <= bench.net.way + 1


def test_stale_messages_make_it_ask_at_once(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    bench.run(5.05)
    before = len(bench.net.asked)
    bench.net.offset += SECOND
    monkeypatch.setattr(Inbox, "stale", property(lambda _inbox: 3))
    bench.run(0.3)
    assert len(bench.net.asked) == before + 1
    assert bench.error() <= bench.net.way + 1


def test_a_silent_source_is_not_asked(bench: Bench) -> None:
    bench.run(3)
    before = len(bench.net.asked)
    bench.run(10, talking=False)
    assert len(bench.net.asked) <= before + 1
    bench.run(2)
    assert len(bench.net.asked) >= before + 2


def test_answers_that_are_none_are_ignored(bench: Bench) -> None:
    answer = Answer(b"c" * 16, 2**63 - 1, -5, 2**62)
    assert unpack_answer(pack_answer(answer)) == answer
    for payload in (b"", b"x" * 44, pack_answer(answer)[:-1], pack_answer(answer) + b"x"):
        assert unpack_answer(payload) is None
        bench.net.reply = payload
        bench.run(2)
    # Of another run of the sender than the one that is heard.
    bench.net.reply = pack_answer(answer)
    bench.run(2)
    assert len(bench.net.asked) > 5
    assert bench.clocks.known("sim") is None
    bench.net.reply = None
    bench.run(2)
    assert bench.clocks.known("sim") is not None


def test_sources_are_bounded(bench: Bench) -> None:
    for boot in range(1000):
        bench.clocks.offset_of(Header(source=f"s{boot}", boot=boot))
    assert len(bench.clocks.sources) == 64
    assert bench.clocks.offset_of(Header()) == UNKNOWN
    assert "" not in bench.clocks.sources


def test_a_flood_of_names_costs_neither_what_is_known_nor_queriers(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    bench.run(0.5)
    assert bench.error() <= bench.net.way
    declared: list[str] = []
    undeclared: list[int] = []

    class Querier:
        def get(self, _handler: Any) -> None:
            return

        def undeclare(self) -> None:
            undeclared.append(1)

    def declare(key: str, **_options: Any) -> Querier:
        declared.append(key)
        return Querier()

    monkeypatch.setattr(bench.net, "declare_querier", declare)
    for boot in range(1000):
        bench.clocks.offset_of(Header(source=f"s{boot}", boot=boot))
        bench.clocks.poll(bench.net.now)
        bench.net.now += 100 * MS
    assert len(declared) > 500
    assert len(declared) - len(undeclared) <= 64
    assert bench.clocks.offset_of(Header(source="sim", boot=bench.net.boot)) != UNKNOWN


def test_one_clock_for_all_processes_of_a_time_namespace() -> None:
    text = "from common.runtime.live.clock_sync import clock_identity as c; print(c().hex())"
    other = subprocess.run(
        [sys.executable, "-c", text], capture_output=True, text=True, cwd=ROOT, check=True
    )
    assert other.stdout.strip() == clock_identity().hex()


class SkewedStack(Stack):
    """Toy services of which the plant's clock is off."""

    def start_shifted(self, *options: str) -> "subprocess.Popen[str]":
        command = [sys.executable, "-m", clock_shim.MODULE, *options]
        command += ["--", "tests.common.runtime.toys", "--kind", "plant", "--rt-priority", "0"]
        command += ["--base-port", str(self.config.base_port)]
        environment = {k: v for k, v in os.environ.items() if not k.startswith("TRILL_")}
        environment |= {"TOY_NAME": "sim", "PYTHONPATH": str(ROOT)}
        process = subprocess.Popen(
            command, env=environment, cwd=ROOT, stderr=subprocess.PIPE, text=True
        )
        self.processes.append(process)
        return process

    def offset_seen(self, by: str, of: str) -> PeerHealth | None:
        health = self.health(by)
        peers = health.peers if health is not None else []
        return next((p for p in peers if p.source == of and p.clock_error >= 0.0), None)

    def agrees(self, by: str, of: str, truth: float) -> bool:
        seen = self.offset_seen(by, of)
        return seen is not None and abs(seen.clock_offset - truth) <= seen.clock_error + 1e-9


@pytest.fixture
def stack() -> Iterator[SkewedStack]:
    running = SkewedStack()
    yield running
    running.stop()


@pytest.mark.parametrize("skew", [-0.2, 0.2])
@pytest.mark.parametrize("namespace", [False, True])
def test_skewed_processes_find_their_offset_and_nothing_is_stale(
    stack: SkewedStack, skew: float, namespace: bool
) -> None:
    if namespace and not clock_shim.has_time_namespaces():
        pytest.skip("needs root and a kernel with time namespaces")
    stack.start_shifted("--skew", str(skew), *(["--namespace"] if namespace else []))
    stack.start("wbc", "controller")
    # Ahead by the skew: the reader's clock minus the sender's is minus that.
    assert stack.until(lambda: stack.agrees("wbc", "sim", -skew))
    assert stack.until(lambda: stack.agrees("sim", "wbc", skew))

    def measured() -> bool:
        link = stack.link("wbc", "plant/state")
        return link is not None and any(stage.stage == "wire" for stage in link.stages)

    assert stack.until(measured)
    link, peer = stack.link("wbc", "plant/state"), stack.offset_seen("wbc", "sim")
    assert link is not None
    assert peer is not None
    wire = next(stage for stage in link.stages if stage.stage == "wire")
    # Uncorrected it would be off by 200 ms, and every state be stale with one of the signs.
    assert -peer.clock_error <= wire.median < 0.15
    assert link.stale == 0


def test_a_clock_set_while_running_is_followed(stack: SkewedStack) -> None:
    stack.start_shifted("--step", "0.15", "--after", "6")
    controller = stack.start("wbc", "controller")
    assert stack.until(lambda: stack.agrees("wbc", "sim", 0.0))
    assert stack.until(lambda: stack.agrees("wbc", "sim", -0.15))
    controller.terminate()
    _, errors = controller.communicate(timeout=30)
    assert "the clock of sim was set" in errors
