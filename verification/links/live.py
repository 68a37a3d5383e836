"""Measure links live: sender and consumers are processes, and links are set over the bus."""

import os
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from common.errors import TrillError
from common.inbox.inbox import Inbox
from common.inbox.subscriptions import subscribe
from common.links.client import read_links, set_links
from common.links.spec import LinkSpec
from common.schemas import StepJournal
from common.topics import HEALTH, JOURNAL
from common.transport.config import BusConfig
from common.transport.keys import subscription_of
from common.transport.session import open_session
from common.wire.codec import decode
from verification.links.parts import LINKS, PART, Sender, live_consumers
from verification.links.records import Measurement, Records

SETTLE_S = 1.5
DRAIN_S = 8.0
"""Nearly every delay is over by then [s]."""
START_S = 60.0


class Bench:
    """Running sender and consumers, with a subscriber to their journals.

    Attributes:
        scheduling: real-time scheduling by service, as its health messages say.
    """

    def __init__(self, session: Any, robot: str) -> None:
        """Subscribe."""
        self._session, self._robot = session, robot
        self._records = {consumer.name: Records() for consumer in live_consumers().values()}
        self.scheduling: dict[str, str] = {}
        self._inbox = Inbox((HEALTH,))
        # Every journal counts, also if this process is late; an inbox would keep the latest only.
        self._journals: deque[bytes] = deque()
        self._subscribers = subscribe(session, robot, self._inbox, (HEALTH,))
        self._subscribers.append(
            session.declare_subscriber(
                subscription_of(robot, JOURNAL),
                lambda sample: self._journals.append(sample.payload.to_bytes()),
            )
        )

    def wait_for_messages(self) -> None:
        """Listen until every consumer has received a message, at most :data:`START_S`."""
        self._listen(START_S, lambda: all(len(some.rows) for some in self._records.values()))

    def measure(self, link: str, seconds: float, drain_s: float = DRAIN_S) -> list[Measurement]:
        """Set ``link`` on the running consumers and measure for ``seconds``.

        What arrived in that time is waited for ``drain_s`` longer.

        Raises:
            LinkControlError: no service answers.
            TrillError: a consumer refuses.
        """
        spec = LinkSpec.parse(link)
        answers = set_links(self._session, self._robot, dict.fromkeys(LINKS, spec))
        if answers.errors:
            raise TrillError(f"{link} was refused: {'; '.join(answers.errors)}")
        self._listen(SETTLE_S)
        start = time.monotonic_ns()
        self._listen(seconds)
        end = time.monotonic_ns()
        self._listen(drain_s)
        return [
            Measurement("live", label, link, self._records[consumer.name].between(start, end))
            for label, consumer in live_consumers().items()
        ]

    def close(self) -> None:
        """Unsubscribe."""
        self._subscribers.clear()

    def _listen(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Take in journals for a while."""
        end = time.monotonic() + seconds
        while time.monotonic() < end and not until():
            self._inbox.begin_step(time.monotonic_ns())
            for name, health in self._inbox.latest_by_source(HEALTH).items():
                self.scheduling[name] = health.realtime
            while self._journals:
                journal = decode(self._journals.popleft(), StepJournal)
                if journal.service in self._records:
                    self._records[journal.service].add(journal)
            time.sleep(0.02)


@contextmanager
def bench(base_port: int, priority: int | None = None) -> Iterator[Bench]:
    """Start sender and consumers; they end with the context.

    Args:
        base_port: first of free ports.
        priority: their SCHED_FIFO priority; None: the services' usual one, if permitted.

    Raises:
        LinkControlError: they do not start.
    """
    names = {Sender.name, *(consumer.name for consumer in live_consumers().values())}
    clean = {k: v for k, v in os.environ.items() if not k.startswith("TRILL_")}
    clean["PYTHONPATH"] = str(Path(__file__).parents[2])
    command = [sys.executable, "-m", "verification.links.parts", "--base-port", str(base_port)]
    if priority is not None:
        command += ["--rt-priority", str(priority)]
    processes = [
        subprocess.Popen(command, env=clean | {PART: name}, stderr=subprocess.DEVNULL)
        for name in sorted(names)
    ]
    config = BusConfig(base_port=base_port)
    session: Any = open_session(config, "monitor")
    running = Bench(session, config.robot)
    try:
        give_up = time.monotonic() + START_S
        while not names <= read_links(session, config.robot, START_S).replies.keys():
            if time.monotonic() > give_up:
                break
        running.wait_for_messages()
        yield running
    finally:
        running.close()
        session.close()
        for process in processes:
            process.terminate()
        for process in processes:
            try:
                process.wait(timeout=10.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
