"""Measure links live: sender and consumers are processes, and links are set over the bus."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from common.errors import TrillError
from common.journal.ledger import Ledger
from common.links.client import read_links, set_links
from common.links.spec import LinkSpec
from common.schemas import ServiceHealth, StepJournal
from common.topics import HEALTH, JOURNAL
from common.transport.config import BusConfig
from common.transport.keys import subscription_of
from common.transport.session import open_session
from common.transport.tap import RawTap
from common.wire.codec import decode
from verification.links.measurement import Measurement, measurements
from verification.links.parts import LINKS, PART, Sender, live_consumers

SETTLE_S = 8.0
"""Longer than nearly every delay: by then messages leave the link as often as they come [s]."""
START_S = 60.0
_JOURNAL_S = 1.0
"""By then the journal of a step has arrived [s]."""


class Bench:
    """Running sender and consumers."""

    def __init__(self, session: Any, robot: str) -> None:
        """Listen to the journals and health messages of the services."""
        self._session, self._robot = session, robot
        self._journals = RawTap(session, robot, expressions=[subscription_of(robot, JOURNAL)])
        self._healths = RawTap(session, robot, expressions=[subscription_of(robot, HEALTH)])

    def measure(self, link: str, seconds: float, settle_s: float = SETTLE_S) -> list[Measurement]:
        """Set ``link`` on the running consumers, let it settle and measure for ``seconds``.

        Raises:
            LinkControlError: no service answers.
            TrillError: a consumer refuses, or receives no message.
        """
        links = dict.fromkeys(LINKS, LinkSpec.parse(link))
        answers = set_links(self._session, self._robot, links)
        if answers.errors:
            raise TrillError(f"{link} was refused: {'; '.join(answers.errors)}")
        time.sleep(settle_s)
        begin = time.monotonic_ns()
        time.sleep(seconds)
        end = time.monotonic_ns()
        time.sleep(_JOURNAL_S)
        ledger = Ledger()
        for sample in self._journals.drain():
            ledger.add(decode(sample.payload, StepJournal), begin, end)
        return measurements("live", link, live_consumers(), ledger)

    def scheduling(self) -> dict[str, str]:
        """Return the real-time scheduling that each service reports."""
        healths = [decode(sample.payload, ServiceHealth) for sample in self._healths.drain()]
        return {health.header.source: health.realtime for health in healths}


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
    try:
        give_up = time.monotonic() + START_S
        while not names <= read_links(session, config.robot, START_S).replies.keys():
            if time.monotonic() > give_up:
                break
        yield Bench(session, config.robot)
    finally:
        session.close()
        for process in processes:
            process.terminate()
        for process in processes:
            try:
                process.wait(timeout=10.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
