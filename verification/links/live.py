"""The links live: sender and consumers are processes, set and measured from here over the bus."""

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
from common.links.client import change, everybody
from common.links.spec import LinkSpec
from common.schemas import StepJournal
from common.topics import HEALTH, JOURNAL
from common.transport.config import BusConfig
from common.transport.keys import subscription_of
from common.transport.session import open_session
from common.wire.codec import decode
from verification.links.parts import Sender, consumers
from verification.links.records import Result, Takes, result

SETTLE_S = 1.5
DRAIN_S = 8.0
"""Nearly every delay is over by then [s]."""
START_S = 60.0


class Bench:
    """Running processes, and a listener to their journals."""

    def __init__(self, session: Any, robot: str) -> None:
        """Listen."""
        self._session, self._robot = session, robot
        self.seen = {part.name: Takes() for part in consumers().values()}
        self.scheduling: dict[str, str] = {}
        self._inbox = Inbox((HEALTH,))
        # Every journal counts, also if this process is late; an inbox would keep the latest.
        self._journals: deque[bytes] = deque()
        self._subscribers = subscribe(session, robot, self._inbox, (HEALTH,))
        self._subscribers.append(
            session.declare_subscriber(
                subscription_of(robot, JOURNAL),
                lambda sample: self._journals.append(sample.payload.to_bytes()),
            )
        )

    def listen(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Take in journals for a while."""
        end = time.monotonic() + seconds
        while time.monotonic() < end and not until():
            self._inbox.begin_step(time.monotonic_ns())
            for name, health in self._inbox.latest_by_source(HEALTH).items():
                self.scheduling[name] = health.realtime
            while self._journals:
                journal = decode(self._journals.popleft(), StepJournal)
                if journal.service in self.seen:
                    self.seen[journal.service].add(journal)
            time.sleep(0.02)

    def measure(
        self, link: str, seconds: float, drain_s: float = DRAIN_S
    ) -> list[tuple[Result, Takes]]:
        """Set ``link`` on the running consumers and measure for ``seconds``.

        What arrived in that time is waited for ``drain_s`` longer.

        Raises:
            LinkControlError: nobody answers.
            TrillError: a consumer refuses.
        """
        spec = LinkSpec.parse(link)
        links: dict[str, LinkSpec | None] = {"teleop/setpoint": spec, "camera/left": spec}
        answers = change(self._session, self._robot, links)
        if answers.errors:
            raise TrillError(f"{link} was refused: {'; '.join(answers.errors)}")
        self.listen(SETTLE_S)
        start = time.monotonic_ns()
        self.listen(seconds)
        end = time.monotonic_ns()
        self.listen(drain_s)
        found = []
        for label, part in consumers().items():
            takes = self.seen[part.name].between(start, end)
            found.append((result("live", label, link, takes), takes))
        return found

    def close(self) -> None:
        """Listen no more."""
        self._subscribers.clear()


@contextmanager
def bench(base_port: int, priority: int | None = None) -> Iterator[Bench]:
    """Start sender and consumers; they end with the context.

    Args:
        base_port: first of free ports.
        priority: SCHED_FIFO priority of them; None: the services' usual one, if permitted.

    Raises:
        LinkControlError: they do not start.
    """
    names = [Sender.name, *(part.name for part in consumers().values())]
    clean = {k: v for k, v in os.environ.items() if not k.startswith("TRILL_")}
    root = str(Path(__file__).parents[2])
    options = [] if priority is None else ["--rt-priority", str(priority)]
    processes = [
        subprocess.Popen(
            [
                sys.executable,
                "-m",
                "verification.links.parts",
                "--base-port",
                str(base_port),
                *options,
            ],
            env=clean | {"LINK_STUDY_PART": name, "PYTHONPATH": root},
            stderr=subprocess.DEVNULL,
        )
        for name in names
    ]
    config = BusConfig(base_port=base_port)
    session: Any = open_session(config, "monitor")
    running = Bench(session, config.robot)
    try:
        give_up = time.monotonic() + START_S
        while time.monotonic() < give_up:
            there = everybody(session, config.robot, START_S).replies.keys()
            if there >= set(names):
                break
        running.listen(START_S, lambda: all(takes.rows for takes in running.seen.values()))
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
