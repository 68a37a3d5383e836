"""The logger's process: bus to tap to queue to file, with its own health on the bus.

It listens to everything and publishes nothing but its health.
"""

import logging
import signal
import time
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import Any

from common.bus.config import BusConfig
from common.bus.inbox import Inbox
from common.bus.publisher import Publisher
from common.bus.session import new_boot_id, open_session
from common.bus.tap import RawTap
from common.runtime.loopstats import LoopStats
from common.runtime.service import Inputs, Output, Service
from common.topics import HEALTH
from services.logger.config import LoggerConfig
from services.logger.recorder import Recorder
from services.logger.sink import McapSink
from services.logger.tally import KeyCount

_log = logging.getLogger("trill.logger")

HEALTH_PERIOD = 0.5
"""Between health messages [s]."""


class LoggerService(Service):
    """One step moves what the tap collected into the recorder's queue.

    The tap's own queue is thereby kept all but empty; if it overflows all the same (this thread
    stood still for many seconds), it says how many it lost but not of which topic.
    """

    name = "logger"
    writes = (HEALTH,)

    def __init__(self, tap: RawTap, recorder: Recorder, period: float) -> None:
        """Connect ``tap`` with ``recorder``; one step each ``period`` [s]."""
        self.period_ns = round(1e9 * period)
        self._tap = tap
        self._recorder = recorder

    def step(self, _inputs: Inputs, _now_ns: int) -> Sequence[Output]:
        """Move samples; end the process when recording failed."""
        for sample in self._tap.drain():
            self._recorder.intake.offer(sample)
        if self._recorder.error is not None:
            self.exit_code = 1
        return ()


class Stopper:
    """Notices SIGINT and SIGTERM without interrupting what is being done."""

    def __init__(self) -> None:
        """Take over both signals; only possible in the main thread."""
        self.stopped = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._note)

    def _note(self, _number: int, _frame: FrameType | None) -> None:
        self.stopped = True


def record(
    bus: BusConfig, path: Path, config: LoggerConfig, stopper: Stopper, realtime: str = "normal"
) -> tuple[dict[str, KeyCount], int]:
    """Record everything on ``bus`` to ``path`` until stopped.

    Returns:
        counts by key, and how many messages were lost before they could be told apart.

    Raises:
        LoggerError: the log cannot be written.
        BusError: the bus cannot be opened.
    """
    # The file first: whoever cannot write need not disturb the bus.
    recorder = Recorder(McapSink(path, bus.robot, config), config)
    recorder.start()
    try:
        session: Any = open_session(bus, LoggerService.name)
        try:
            tap = RawTap(session, bus.robot)
            service = LoggerService(tap, recorder, config.drain_period)
            publisher = Publisher(session, bus.robot, HEALTH, service.name, new_boot_id())
            _log.info("recording %s/** to %s", bus.robot, path)
            _loop(service, publisher, LoopStats(service, realtime), stopper)
            tap.close()
            service.step(Inbox(()), time.monotonic_ns())
        finally:
            session.close()
    finally:
        report = recorder.stop()
    return report, tap.dropped


def _loop(
    service: LoggerService, publisher: Publisher[Any], stats: LoopStats, stopper: Stopper
) -> None:
    """Step at the service's period and publish health, until stopped or failed."""
    inbox = Inbox(())
    next_health = time.monotonic()
    while not stopper.stopped and service.exit_code is None:
        started = time.monotonic_ns()
        service.step(inbox, started)
        took = time.monotonic_ns() - started
        stats.count(took, took > service.period_ns)
        if 1e-9 * started >= next_health:
            next_health += HEALTH_PERIOD
            publisher.send(stats.health(inbox))
        time.sleep(max(0.0, 1e-9 * (service.period_ns - took)))
