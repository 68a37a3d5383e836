"""The logger's process: bus to queue to file, with its own health on the bus unless it observes.

It listens to everything, answers questions about itself, and publishes nothing but its health.
"""

import logging
import os
import secrets
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from common.inbox.inbox import Inbox
from common.runtime.live.loop_stats import LoopStats
from common.runtime.service import Inputs, Output, Service
from common.topics import HEALTH
from common.transport.config import BusConfig
from common.transport.publisher import Publisher
from common.transport.schema_query import SchemaServer
from common.transport.session import new_boot_id, open_session
from common.transport.tap import RawTap
from services.logger.errors import LoggerError
from services.logger.log_format import write_error
from services.logger.read.delivery import DeliveryCount
from services.logger.read.episodes import EpisodeBook
from services.logger.read.info import read_episodes
from services.logger.read.locks import is_locked
from services.logger.read.segments import existing_segments, next_segment
from services.logger.record.attach import descriptions_of, find_robot
from services.logger.record.config import LoggerConfig
from services.logger.record.episode_queries import EpisodeQueryServer
from services.logger.record.recorder import Recorder
from services.logger.record.selection import Selection
from services.logger.record.sink import McapSink
from services.logger.record.status import Status

_log = logging.getLogger("trill.logger")

HEALTH_PERIOD = 0.5
"""Between health messages [s]."""
ASK_PERIOD = 5.0
"""Between questions what a topic without a schema is [s]; longer and longer if nobody knows."""


class LoggerService(Service):
    """What the logger is to the rest: a name, a period, its health."""

    name = "logger"
    writes = (HEALTH,)

    def __init__(self, recorder: Recorder, tap: RawTap, period: float) -> None:
        """Watch ``recorder`` and the ``tap`` that feeds it, once each ``period`` [s]."""
        self.period_ns = round(1e9 * period)
        self._recorder = recorder
        self._tap = tap

    def step(self, _inputs: Inputs, _now_ns: int) -> Sequence[Output]:
        """End the process when receiving or writing failed; the samples go their own way."""
        if self._recorder.error is not None or self._tap.error is not None:
            self.exit_code = 1
        return ()


@dataclass(frozen=True)
class Order:
    """What is to be recorded, and how.

    Attributes:
        bus: how to reach it.
        path: the recording's first part; a further one is begun if it exists.
        config: of the logger.
        observe: publish nothing at all, not even health.
        ask: find out which robot there is, instead of taking the bus's.
        live: show a status line on the standard error.
        realtime: scheduling in force, for the health message.
    """

    bus: BusConfig
    path: Path
    config: LoggerConfig
    observe: bool = False
    ask: bool = False
    live: bool = False
    realtime: str = "normal"


def record(order: Order, stopping: Callable[[], bool]) -> dict[str, DeliveryCount]:
    """Record until ``stopping`` says True; returns the counts by key.

    Raises:
        LoggerError: the log cannot be written, another recorder is at it, or no robot is found.
        BusError: the bus cannot be opened.
        ConfigError: a pattern of topics is none.
    """
    _make_room(order.path)
    busy = next((p for p in existing_segments(order.path) if p.exists() and is_locked(p)), None)
    if busy is not None:
        raise LoggerError(
            f"{busy} is being recorded by another logger; two in one directory would be read as "
            "one log: give another --out"
        )
    Selection(order.bus.robot, order.config.topics, order.config.exclude)
    session: Any = open_session(order.bus, LoggerService.name, stopping)
    try:
        robot = order.bus.robot
        if order.ask:
            robot = find_robot(
                session,
                ", ".join(order.bus.connect_endpoints(LoggerService.name)),
                stopping=stopping,
            )
        return _Recording(order, session, robot).run(stopping)
    finally:
        session.close()


class _Recording:
    """The parts of a running recorder on an open session."""

    def __init__(self, order: Order, session: Any, robot: str) -> None:
        self._order = order
        self._session = session
        self._robot = robot
        config = order.config
        self._selection = Selection(robot, config.topics, config.exclude)
        about = {
            "session": secrets.token_hex(8),
            "topics": " ".join(config.topics),
            "exclude": " ".join(config.exclude),
        }

        def new_part() -> McapSink:
            path = next_segment(order.path)
            asked = ", ".join(f"{robot}/{topic}" for topic in config.topics) or f"{robot}/**"
            _log.info("recording %s to %s", asked, path)
            return McapSink(path, robot, config, about)

        earlier = [path for path in existing_segments(order.path) if path.exists()]
        numbers = [one.episode for one in read_episodes(earlier)]
        rotates = config.rotate_size is not None or config.rotate_every is not None
        self._recorder = Recorder(
            new_part(),
            config,
            robot=robot,
            next_sink=new_part if rotates else None,
            episodes=EpisodeBook(next_number=max(numbers, default=-1) + 1),
        )
        self._ask_at = 0.0
        self._ask_after = ASK_PERIOD

    def run(self, stopping: Callable[[], bool]) -> dict[str, DeliveryCount]:
        recorder = self._recorder
        recorder.start()
        try:
            # What is known of the topics first, so that their first messages have schemas.
            asks = self._order.ask or self._order.observe or bool(self._order.config.exclude)
            known = descriptions_of(self._session, self._robot) if asks else {}
            recorder.describe(known)
            tap = RawTap(
                self._session,
                self._robot,
                deliver=recorder.intake.offer,
                expressions=self._selection.expressions(known),
                accept=self._selection.wants,
            )
            desk = EpisodeQueryServer(self._session, self._robot, recorder)
            try:
                self._loop(tap, stopping)
            finally:
                desk.close()
                tap.close()
        finally:
            report = recorder.stop()
        if tap.error is not None:
            raise LoggerError(
                f"receiving failed: {type(tap.error).__name__}: {tap.error}; {recorder.path} has "
                "what arrived before"
            ) from tap.error
        return report

    def _loop(self, tap: RawTap, stopping: Callable[[], bool]) -> None:
        """Step at the service's period and publish health, until stopped or failed."""
        order = self._order
        service = LoggerService(self._recorder, tap, order.config.drain_period)
        stats = LoopStats(service, order.realtime)
        health = None if order.observe else _Health(self._session, self._robot)
        status = Status(self._recorder, order.config.low_disk, sys.stderr, live=order.live)
        inbox = Inbox(())
        self._ask_at = time.monotonic() + ASK_PERIOD
        while not stopping() and service.exit_code is None:
            started = time.monotonic_ns()
            service.step(inbox, started)
            took = time.monotonic_ns() - started
            stats.count(took, took > service.period_ns)
            now = 1e-9 * started
            if health is not None:
                health.update(now, stats, inbox)
            status.update(now)
            self._ask_again(now, tap)
            time.sleep(max(0.0, 1e-9 * (service.period_ns - took)))
        status.end()
        if health is not None:
            health.close()

    def _ask_again(self, now: float, tap: RawTap) -> None:
        """Ask what is not known yet; services come later than the recorder."""
        partial = bool(self._order.config.exclude)
        if now < self._ask_at or not (self._recorder.undescribed or partial):
            return
        known = descriptions_of(self._session, self._robot, timeout=0.5)
        self._recorder.describe(known)
        for expression in self._selection.expressions(known) if partial else ():
            tap.listen(expression)
        self._ask_after = min(60.0, 1.5 * self._ask_after)
        self._ask_at = now + self._ask_after


class _Health:
    """The logger's own health, the one thing it publishes."""

    def __init__(self, session: Any, robot: str) -> None:
        self._publisher = Publisher(session, robot, HEALTH, LoggerService.name, new_boot_id())
        self._schemas = SchemaServer(robot, LoggerService.name, LoggerService.writes)
        self._schemas.open(session)
        self._next = 0.0

    def update(self, now: float, stats: LoopStats, inbox: Inbox) -> None:
        if now >= self._next:
            self._next = max(self._next + HEALTH_PERIOD, now)
            self._publisher.send(stats.health(inbox))

    def close(self) -> None:
        self._schemas.close()
        self._publisher.close()


def _make_room(path: Path) -> None:
    """Make the directory first: whoever cannot write need not disturb the bus."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if not os.access(path.parent, os.W_OK):
            raise PermissionError(13, "Permission denied")
    except OSError as error:
        raise write_error(path, error) from error
