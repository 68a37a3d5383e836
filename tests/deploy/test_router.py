"""The router as a process, between peers of this process and clients of its own."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest

from common.inbox.inbox import Inbox
from common.inbox.subscriptions import subscribe
from common.schemas import CameraFrame, Estop
from common.topics import CAMERA_LEFT, ESTOP, Topic
from common.transport.config import BusConfig
from common.transport.publisher import Publisher
from common.transport.session import open_session
from services.logger.read.reader import LogReader
from tests.common.transport.support import free_base_port

PATIENCE = 60.0
BOOT = 1


class Router:
    """``python -m deploy.router`` with what it says."""

    def __init__(self, base_port: int, log: Path) -> None:
        self._log = log
        with log.open("wb") as stream:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "deploy.router", "--base-port", str(base_port)],
                stdout=stream,
                stderr=subprocess.STDOUT,
            )

    def said(self) -> str:
        return self._log.read_text()

    def connected(self) -> str:
        """Who is connected, as it said last."""
        return self.said().rpartition("connected: ")[2].strip()

    def end(self, number: signal.Signals) -> int:
        self.process.send_signal(number)
        return self.process.wait(PATIENCE)


class Place:
    """Sessions, readers and processes of one test, on ports of its own."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        # From one below the base port on.
        self.base_port = free_base_port(12) + 1
        self.peers = BusConfig(base_port=self.base_port)
        self.clients = BusConfig(base_port=self.base_port, mode="client")
        self._stack = stack
        self._folder = folder
        self._routers = 0

    def router(self) -> Router:
        self._routers += 1
        router = Router(self.base_port, self._folder / f"router-{self._routers}.txt")
        self._stack.callback(router.process.wait)
        self._stack.callback(router.process.kill)
        until(lambda: "listening on" in router.said(), router.said)
        return router

    def peer(self, name: str) -> Any:
        return self._session(name, self.peers)

    def client(self, name: str) -> Any:
        return self._session(name, self.clients)

    def reader(self, session: Any, topic: Topic[Any]) -> Inbox:
        inbox = Inbox((topic,))
        subscribers = subscribe(session, "draco3", inbox, (topic,))
        self._stack.callback(subscribers.clear)
        return inbox

    def _session(self, name: str, config: BusConfig) -> Any:
        session: Any = open_session(config, name)
        self._stack.callback(session.close)
        return session


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    with ExitStack() as stack:
        yield Place(stack, tmp_path)


def until(condition: Callable[[], bool], story: Callable[[], str] = str) -> None:
    deadline = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < deadline, f"waited in vain; {story()}"
        time.sleep(0.02)


def stops(session: Any, name: str) -> Publisher[Any]:
    return Publisher(session, "draco3", ESTOP, name, BOOT)


class Ear:
    """Numbers of the events an inbox got, in the order they came."""

    def __init__(self, inbox: Inbox) -> None:
        self._inbox = inbox
        self.numbers: list[int] = []

    def listen(self) -> list[int]:
        self._inbox.begin_step(time.monotonic_ns())
        self.numbers += [event.header.seq for event in self._inbox.events(ESTOP)]
        return self.numbers


def acquaint(publisher: Publisher[Any], *ears: Ear) -> int:
    """Send until everyone heard the same message; returns its number."""

    def known() -> bool:
        publisher.send(Estop(reason="anybody there?"))
        time.sleep(0.05)  # it needs its time to arrive
        return all(publisher.sent - 1 in ear.listen() for ear in ears)

    until(known)
    until(lambda: all(publisher.sent - 1 in ear.listen() for ear in ears))
    return publisher.sent - 1


def exchange(publisher: Publisher[Any], ears: list[Ear], messages: int = 60) -> None:
    """Send at a person's pace; every ear must get each message once and in order."""
    first = acquaint(publisher, *ears) + 1
    for _ in range(messages):
        publisher.send(Estop(reason="again"))
        time.sleep(0.005)
    wanted = list(range(first, first + messages))
    for ear in ears:
        until(lambda ear=ear: wanted[-1] in ear.listen())  # type: ignore[misc]
        time.sleep(0.05)  # a copy of the last one would come about now
        assert [number for number in ear.listen() if number >= first] == wanted


@pytest.mark.parametrize("router_first", [True, False])
def test_peers_and_client_hear_each_other_once_whoever_came_first(
    place: Place, router_first: bool
) -> None:
    if router_first:
        router = place.router()
    sim, wbc = place.peer("sim"), place.peer("wbc")
    if not router_first:
        router = place.router()
    viewer = place.client("viewer")
    at_wbc, at_viewer = Ear(place.reader(wbc, ESTOP)), Ear(place.reader(viewer, ESTOP))
    exchange(stops(sim, "sim"), [at_wbc, at_viewer])
    at_sim, at_wbc = Ear(place.reader(sim, ESTOP)), Ear(place.reader(wbc, ESTOP))
    exchange(stops(viewer, "viewer"), [at_sim, at_wbc])
    until(lambda: router.connected() == "2 peers, 1 client", router.said)


def test_an_observer_beside_the_robot_hears_who_comes_through_the_router(place: Place) -> None:
    router = place.router()
    sim = place.peer("sim")
    # Neither of the table nor a client, as `trill top`, `mark` and `latency` are.
    observer, operator = place.peer("observer"), place.client("operator")
    at_sim, at_observer = Ear(place.reader(sim, ESTOP)), Ear(place.reader(observer, ESTOP))
    exchange(stops(operator, "operator"), [at_sim, at_observer])
    exchange(stops(sim, "sim"), [Ear(place.reader(observer, ESTOP))])
    until(lambda: router.connected() == "2 peers, 1 client", router.said)


def test_peers_do_without_a_killed_router_and_clients_come_back_to_the_next(place: Place) -> None:
    sim, wbc = place.peer("sim"), place.peer("wbc")
    router = place.router()
    publisher = stops(sim, "sim")
    at_wbc = Ear(place.reader(wbc, ESTOP))
    at_viewer = Ear(place.reader(place.client("viewer"), ESTOP))
    first = acquaint(publisher, at_wbc, at_viewer) + 1
    for number in range(first, first + 100):
        if number == first + 30:
            router.end(signal.SIGKILL)
        assert publisher.send(Estop(reason="again"))
        time.sleep(0.01)
    wanted = list(range(first, first + 100))
    until(lambda: wanted[-1] in at_wbc.listen())
    assert [number for number in at_wbc.listen() if number >= first] == wanted
    assert wanted[-1] not in at_viewer.listen()
    place.router()
    exchange(publisher, [at_wbc, at_viewer])


@contextmanager
def far_logger(place: Place, out: Path) -> Iterator["subprocess.Popen[bytes]"]:
    process = subprocess.Popen(
        [
            *(sys.executable, "-m", "services.logger", "--out", str(out)),
            *("--mode", "client", "--base-port", str(place.base_port), "--robot", "draco3"),
        ],
        stdout=subprocess.DEVNULL,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def picture(number: int) -> CameraFrame:
    data = os.urandom(500_000)
    return CameraFrame(eye="left", width=400, height=300 + number, encoding="jpeg", data=data)


def test_a_client_that_stands_still_costs_peers_nothing(place: Place, tmp_path: Path) -> None:
    place.router()
    sim, wbc = place.peer("sim"), place.peer("wbc")
    cameras = Publisher(sim, "draco3", CAMERA_LEFT, "sim", BOOT)
    publisher, at_wbc = stops(sim, "sim"), Ear(place.reader(wbc, ESTOP))
    with far_logger(place, tmp_path) as logger:
        # The logger subscribes to everything; nobody else wants pictures.
        until(lambda: cameras.wanted)
        first = acquaint(publisher, at_wbc) + 1
        logger.send_signal(signal.SIGSTOP)
        for number in range(first, first + 80):
            # 40 MB in all: far more than the sockets on the way to the logger hold.
            cameras.send(picture(number - first))
            publisher.send(Estop(reason="again"))
            time.sleep(0.02)
        wanted = list(range(first, first + 80))
        until(lambda: wanted[-1] in at_wbc.listen())
        assert [number for number in at_wbc.listen() if number >= first] == wanted
        logger.send_signal(signal.SIGCONT)
        # It comes back by itself and records what is sent from then on.
        log = tmp_path / "log.mcap"
        until(lambda: _recorded(log, publisher) >= first + 80)
    pictures = sum(entry.topic is CAMERA_LEFT for entry in LogReader(log).raw_messages())
    assert pictures < 80, "the logger never fell behind: nothing was tested"


def _recorded(log: Path, publisher: Publisher[Any]) -> int:
    """Send once more and return the number of the last message in the log; -1 for none."""
    publisher.send(Estop(reason="still there?"))
    entries = LogReader(log).raw_messages() if log.exists() else ()
    return max((entry.sequence for entry in entries if entry.topic is ESTOP), default=-1)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_well(place: Place, number: signal.Signals) -> None:
    router = place.router()
    viewer = place.client("viewer")
    until(lambda: router.connected() == "1 client", router.said)
    assert router.end(number) == 0
    assert "stopped" in router.said()
    assert "Traceback" not in router.said()
    del viewer
