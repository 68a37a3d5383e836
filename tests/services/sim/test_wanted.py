"""A live service learns whether anybody reads what it publishes, across two real sessions."""

import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import pytest

from common.inbox.inbox import Inbox
from common.inbox.subscriptions import subscribe
from common.runtime.live.config import RuntimeConfig
from common.runtime.live.runner import LiveRunner
from common.runtime.service import Inputs, Output, Service
from common.topics import CAMERA_LEFT, CAMERA_RIGHT, PLANT_STATE
from common.transport.config import BusConfig
from common.transport.session import open_session

from .support import MS


class Witness(Service):
    """Notes at each step which of its topics are wanted."""

    name = "witness"
    period_ns = 10 * MS
    writes = (CAMERA_LEFT, CAMERA_RIGHT)

    def __init__(self) -> None:
        self.seen: set[str] = set()

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        self.seen = {topic.name for topic in self.writes if self.wanted(topic)}
        return []


@pytest.fixture
def endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@pytest.fixture
def witness(endpoint: str) -> Iterator[Witness]:
    service = Witness()
    bus = BusConfig(listen=(endpoint,), connect=())
    runner = LiveRunner(service, bus, runtime=RuntimeConfig(rt_priority=0))
    thread = threading.Thread(target=runner.run)
    thread.start()
    yield service
    runner.stop()
    thread.join(10.0)
    assert not thread.is_alive()


def eventually(condition: Callable[[], bool]) -> bool:
    deadline = time.monotonic() + 10.0
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.02)
    return condition()


def test_everything_is_wanted_outside_the_live_runner() -> None:
    assert Witness().wanted(CAMERA_LEFT)


def test_only_subscribed_topics_are_wanted(witness: Witness, endpoint: str) -> None:
    session: Any = open_session(BusConfig(listen=(), connect=(endpoint,)), "reader")
    try:
        topics = (CAMERA_RIGHT, PLANT_STATE)
        inbox = Inbox(topics, service="reader")
        subscribers = subscribe(session, "draco3", inbox, topics)
        assert eventually(lambda: witness.seen == {CAMERA_RIGHT.name})
        for subscriber in subscribers:
            subscriber.undeclare()
        assert eventually(lambda: witness.seen == set())
    finally:
        session.close()
