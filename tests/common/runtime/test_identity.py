"""One plant, one controller: the newcomer of two ends in words, and a restart is not refused."""

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from common.errors import EXIT_NAME_TAKEN
from common.ports import PORT_OFFSETS
from common.runtime.live import identity
from common.runtime.live.config import RuntimeConfig
from common.runtime.live.identity import NEWCOMER_NS, Rivals, names_of_one
from common.runtime.live.runner import LiveRunner
from common.runtime.service import Service
from common.schemas import Header, Heartbeat
from common.topics import HEARTBEAT, WBC_STATE
from common.transport.config import BusConfig
from common.transport.publisher import Publisher
from common.transport.session import open_session
from tests.common.runtime.toys import ToyController, ToyPlant
from tests.common.transport.support import free_base_port

S = 1_000_000_000
QUIET = RuntimeConfig(rt_priority=0, spin_us=0)


def until(condition: Callable[[], bool]) -> None:
    give_up = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < give_up, "waited in vain"
        time.sleep(0.01)


def test_of_two_the_younger_gives_way_and_only_it() -> None:
    """Each hears the other 50 ms late, so each takes the other for younger than it is."""
    late = S // 20
    for head_start in (0, S // 100, S, 100 * S):
        older, younger = Rivals(1, 0, yields=True), Rivals(2, head_start, yields=True)
        now = head_start + S
        older.hear("sim", 2, now - late - head_start, now)
        younger.hear("sim", 1, now - late, now)
        older.answer(2)
        younger.answer(1)
        assert older.older(now) is None
        assert (younger.older(now) is not None) is (head_start > late)


def test_who_does_not_answer_is_not_there() -> None:
    rivals = Rivals(2, 100 * S, yields=True)
    rivals.hear("wbc", 1, 100 * S, 101 * S)
    assert rivals.older(101 * S) is None
    assert [gone.boot for gone in rivals.forget_silent(103 * S)] == [1]
    rivals.answer(1)
    assert rivals.older(103 * S) is None


def test_own_heartbeats_are_nobody() -> None:
    rivals = Rivals(2, 0, yields=True)
    rivals.hear("wbc", 2, 10 * S, S)
    assert not rivals.by_boot


@pytest.mark.parametrize(("up", "gives_way"), [(NEWCOMER_NS - 1, True), (NEWCOMER_NS + 1, False)])
def test_who_has_run_for_a_while_stays(up: int, gives_way: bool) -> None:
    rivals = Rivals(2, 100 * S, yields=True)
    now = 100 * S + up
    rivals.hear("wbc", 1, 50 * S, now)
    rivals.answer(1)
    assert (rivals.older(now) is not None) is gives_way


def test_simulated_and_real_plant_are_in_one_place() -> None:
    assert set(names_of_one("sim")) == {"sim", "plant"}
    assert names_of_one("wbc") == ("wbc",)


class Controller(ToyController):
    """Publishes an exclusive topic, as the real one does."""

    writes = (*ToyController.writes, WBC_STATE)


class Bus:
    """Runs services in threads, each on a port of its own as if on another host."""

    def __init__(self, stack: ExitStack) -> None:
        self.base = free_base_port(16)
        self.codes: dict[int, int] = {}
        self._stack = stack

    def config(self, name: str, other: bool) -> BusConfig:
        if not other:
            return BusConfig(base_port=self.base)
        connect = (f"tcp/127.0.0.1:{self.base + PORT_OFFSETS[name]}",)
        return BusConfig(listen=("tcp/127.0.0.1:0",), connect=connect)

    def run(self, service: Service, *, beside: str = "") -> LiveRunner:
        """Start a service; ``beside``: connected to that one, not to the port table."""
        config = self.config(beside or service.name, bool(beside))
        runner = LiveRunner(service, config, runtime=QUIET)

        def live() -> None:
            self.codes[id(runner)] = runner.run()

        thread = threading.Thread(target=live)
        thread.start()

        def end() -> None:
            runner.stop()
            thread.join()

        self._stack.callback(end)
        return runner

    def ended(self, runner: LiveRunner) -> int | None:
        return self.codes.get(id(runner))


@pytest.fixture
def bus() -> Iterator[Bus]:
    with ExitStack() as stack:
        yield Bus(stack)


def steps(runner: LiveRunner) -> int:
    return int(runner._stats.steps)


@pytest.mark.parametrize(("first", "second"), [("sim", "sim"), ("sim", "plant"), ("wbc", "wbc")])
def test_a_second_one_ends_and_says_why(
    bus: Bus, caplog: pytest.LogCaptureFixture, first: str, second: str
) -> None:
    def service(name: str) -> Service:
        made = Controller() if name == "wbc" else ToyPlant(period_ns=5_000_000)
        made.name = name
        return made

    running = bus.run(service(first))
    until(lambda: steps(running) > 20)
    newcomer = service(second)
    refused = bus.run(newcomer, beside=first)
    until(lambda: bus.ended(refused) is not None)
    assert bus.ended(refused) == EXIT_NAME_TAKEN
    assert f"another {first} (boot" in caplog.text
    assert "stop the other first" in caplog.text
    if isinstance(newcomer, ToyPlant):
        # It looks before it publishes anything.
        assert newcomer.steps == 0
    assert bus.ended(running) is None


def test_a_restart_is_not_refused_because_of_heartbeats_under_way(bus: Bus) -> None:
    """The old life still beats, as over a slow network, but it is gone: it does not answer."""
    config = bus.config("sim", False)
    runner = bus.run(ToyPlant(period_ns=5_000_000))
    session: Any = open_session(config.model_copy(update={"listen": ()}), "ghost")
    ghost = Publisher(session, "draco3", HEARTBEAT, "sim", boot=77)
    end = time.monotonic() + 1.2
    while time.monotonic() < end:
        ghost.send(Heartbeat(steps=9, timeout=0.1, uptime=3600.0, header=Header()))
        time.sleep(0.02)
    assert runner._identity.report()["conflict"].startswith("another sim (boot 4d, up 360")
    assert bus.ended(runner) is None
    until(lambda: not runner._identity.report()["conflict"])
    until(lambda: steps(runner) > 50)
    session.close()


def test_two_that_have_run_for_a_while_both_warn_and_go_on(
    bus: Bus, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """As after a network was cut in two and came together again."""
    caplog.set_level(logging.WARNING, logger=identity.__name__)
    monkeypatch.setattr(identity, "NEWCOMER_NS", 0)
    both = [bus.run(Controller()), bus.run(Controller(), beside="wbc")]
    until(lambda: all(runner._identity.report()["conflict"] for runner in both if steps(runner)))
    until(lambda: caplog.text.count("is on the bus too") >= 2)
    before = [steps(runner) for runner in both]
    until(lambda: all(steps(runner) > count for runner, count in zip(both, before, strict=True)))
    assert not bus.codes


def test_operators_of_one_name_share_the_bus(bus: Bus) -> None:
    """Who of them has the robot is the controller's decision."""

    class Operator(ToyController):
        name = "keyboard"
        writes = ()

        def step(self, inputs: Any, now_ns: int) -> list[Any]:
            return []

    both = [bus.run(Operator()), bus.run(Operator(), beside="keyboard")]
    until(lambda: all(steps(runner) and runner._identity.report()["conflict"] for runner in both))
    assert not bus.codes
