"""The logger's process: records the bus into files and publishes its own health.

It answers queries about schemas and episodes. As an observer it publishes nothing at all.
"""

import logging
import secrets
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from common.runtime.live.loop_stats import LoopStats
from common.topics import HEALTH
from common.transport.config import BusConfig
from common.transport.publisher import Publisher
from common.transport.schema_query import SchemaServer
from common.transport.session import new_boot_id, open_session
from common.transport.tap import RawTap
from services.logger.errors import LoggerError
from services.logger.read.delivery import DeliveryCount
from services.logger.read.episodes import EpisodeBook
from services.logger.read.info import read_episodes
from services.logger.read.locks import is_locked
from services.logger.read.segments import existing_segments
from services.logger.record.attach import descriptions_of, find_robot
from services.logger.record.config import LoggerConfig
from services.logger.record.episode_queries import EpisodeQueryServer
from services.logger.record.files import RecordingFiles, check_space, make_directory
from services.logger.record.recorder import Recorder
from services.logger.record.selection import Selection
from services.logger.record.status import Status

_log = logging.getLogger("trill.logger")

NAME = "logger"
HEALTH_PERIOD = 0.5
"""Time between health messages [s]."""
SILENCE = 2.0
"""Without any message for so long a person is told where the recorder listens [s]."""
QUERY_PERIOD = 5.0
"""First time between queries for missing schemas [s]; it grows while there is no answer."""
_LONGEST_QUERY_PERIOD = 60.0


@dataclass(frozen=True)
class RecordingOptions:
    """What to record, and how.

    Attributes:
        bus: the bus to record.
        path: the recording's first segment; if it exists, the recording continues in a new one.
        config: of the logger.
        observe: publish nothing at all, not even health.
        find_robot: query the robot's name instead of using that in ``bus``.
        live: show a status line on the standard error.
        realtime: scheduling in force, for the health message.
    """

    bus: BusConfig
    path: Path
    config: LoggerConfig
    observe: bool = False
    find_robot: bool = False
    live: bool = False
    realtime: str = "normal"


def record(options: RecordingOptions, stopping: Callable[[], bool]) -> dict[str, DeliveryCount]:
    """Record until ``stopping`` returns True; return the delivery counts by key.

    Raises:
        LoggerError: receiving or writing failed, another recorder writes there, or no robot is
            found.
        BusError: the bus cannot be opened.
        ConfigError: a pattern of topics is invalid.
    """
    make_directory(options.path)
    check_space(options.path, options.config.min_free)
    _check_alone(options.path)
    Selection(options.bus.robot, options.config.topics, options.config.exclude)
    session: Any = open_session(options.bus, NAME, stopping)
    try:
        robot = options.bus.robot
        if options.find_robot:
            robot = find_robot(
                session,
                ", ".join(options.bus.connect_endpoints(NAME)),
                stopping=stopping,
            )
        # Another one may have been started at the same time.
        _check_alone(options.path)
        return _Recording(options, session, robot).run(stopping)
    finally:
        session.close()


def _check_alone(path: Path) -> None:
    """Check that no other recorder writes there.

    Raises:
        LoggerError: one does.
    """
    busy = next((p for p in existing_segments(path) if p.exists() and is_locked(p)), None)
    if busy is not None:
        raise LoggerError(
            f"{busy} is being recorded by another logger; both would be read as one log: give "
            "another --out"
        )


class _Recording:
    """A running recorder with its tap and queries, on an open session."""

    def __init__(self, options: RecordingOptions, session: Any, robot: str) -> None:
        self._options = options
        self._session = session
        self._robot = robot
        config = options.config
        self._selection = Selection(robot, config.topics, config.exclude)
        about = {"topics": " ".join(config.topics), "exclude": " ".join(config.exclude)}
        files = RecordingFiles(options.path, robot, config, secrets.token_hex(8), about)
        earlier = [path for path in existing_segments(options.path) if path.exists()]
        numbers = [one.episode for one in read_episodes(earlier)]
        self._recorder = Recorder(
            files.open_next(),
            config,
            robot=robot,
            next_sink=files.open_next if config.rotates else None,
            episodes=EpisodeBook(next_number=max(numbers, default=-1) + 1),
        )
        self._query_at = 0.0
        self._query_period = QUERY_PERIOD

    def run(self, stopping: Callable[[], bool]) -> dict[str, DeliveryCount]:
        recorder = self._recorder
        recorder.start()
        try:
            # Query the descriptions first, so that the topics' first messages have schemas.
            options = self._options
            queries = options.find_robot or options.observe or bool(options.config.exclude)
            known = descriptions_of(self._session, self._robot) if queries else {}
            recorder.describe(known)
            tap = RawTap(
                self._session,
                self._robot,
                deliver=recorder.intake.offer,
                expressions=self._selection.expressions(known),
                accept=self._selection.wants,
            )
            episode_queries = EpisodeQueryServer(self._session, self._robot, recorder)
            try:
                self._loop(tap, stopping)
            finally:
                episode_queries.close()
                tap.close()
                if tap.refused:
                    _log.warning("not recorded: %d messages put on wildcard keys", tap.refused)
        finally:
            report = recorder.stop()
        check_space(recorder.path, options.config.min_free)
        if tap.error is not None:
            raise LoggerError(
                f"receiving failed: {type(tap.error).__name__}: {tap.error}; {recorder.path} has "
                "what arrived before"
            ) from tap.error
        return report

    def _loop(self, tap: RawTap, stopping: Callable[[], bool]) -> None:
        """Publish health and show the status, until stopped or failed."""
        options = self._options
        period_ns = round(1e9 * options.config.drain_period)
        stats = LoopStats(NAME, period_ns, options.realtime)
        health = None if options.observe else _Health(self._session, self._robot)
        config = options.config
        status = Status(
            self._recorder, config.low_disk, sys.stderr, live=options.live, min_free=config.min_free
        )
        self._query_at = time.monotonic() + QUERY_PERIOD
        silent_at: float | None = time.monotonic() + SILENCE
        while not (stopping() or self._recorder.error or tap.error):
            started = time.monotonic_ns()
            now = 1e-9 * started
            if health is not None:
                health.update(now, stats)
            if silent_at is not None and (tap.received or now >= silent_at):
                if not tap.received:
                    status.end()
                    _log.warning("%s", silence_text(options.bus, self._robot, options.config))
                silent_at = None
            status.update(now)
            if status.is_full:
                break
            took = time.monotonic_ns() - started
            stats.count(took, took > period_ns)
            self._query_again(now, tap)
            time.sleep(max(0.0, 1e-9 * (period_ns - took)))
        status.end()
        if health is not None:
            health.close()

    def _query_again(self, now: float, tap: RawTap) -> None:
        """Query missing descriptions; services may start later than the recorder."""
        partial = bool(self._options.config.exclude)
        if now < self._query_at or not (self._recorder.undescribed or partial):
            return
        known = descriptions_of(self._session, self._robot, timeout=0.5)
        self._recorder.describe(known)
        for expression in self._selection.expressions(known) if partial else ():
            tap.listen(expression)
        self._query_period = min(_LONGEST_QUERY_PERIOD, 1.5 * self._query_period)
        self._query_at = now + self._query_period


def silence_text(bus: BusConfig, robot: str, config: LoggerConfig) -> str:
    """Return what to say when nothing was heard: where it was looked for, and what may help."""
    if bus.mode == "client":
        where = f"as a client of {', '.join(bus.connect_endpoints(NAME))}"
        help_ = "check the address of --connect and the name of --robot"
    else:
        where = f"beside a robot on this machine or network, at base port {bus.base_port}"
        help_ = (
            "is it running (trill up), and with this --base-port and --robot? A robot in "
            "containers or on another machine takes --connect tcp/HOST:7447"
        )
    topics = f" of {', '.join(config.topics)}" if config.topics else ""
    return f"nothing{topics} heard from {robot} for {SILENCE:g} s {where}: {help_}; still listening"


class _Health:
    """Publishes the logger's own health."""

    def __init__(self, session: Any, robot: str) -> None:
        self._publisher = Publisher(session, robot, HEALTH, NAME, new_boot_id())
        self._schemas = SchemaServer(session, robot, NAME, (HEALTH,))
        self._next = 0.0

    def update(self, now: float, stats: LoopStats) -> None:
        if now >= self._next:
            self._next = max(self._next + HEALTH_PERIOD, now)
            self._publisher.send(stats.health(links=[]))

    def close(self) -> None:
        self._schemas.close()
        self._publisher.close()
