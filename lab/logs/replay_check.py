"""Replays services from a log: glue between the logger's reader and the replay runner."""

import importlib
import json
import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from common.errors import ConfigError
from common.runtime.replay.result import Report
from common.runtime.replay.runner import Progress, ReplayRunner
from common.runtime.replay.runs import Recorded, ServiceRun, find_runs
from common.runtime.service import Service
from common.schemas import Message
from common.tables import overlaid
from common.topics import Topic
from common.transport.keys import key_of
from common.transport.tap import RawSample
from common.wire.codec import schema_tag
from common.wire.header import wire_header
from services.logger.read.reader import LogReader
from services.logger.record.config import LoggerConfig
from services.logger.record.sink import McapSink

SERVICES: Mapping[str, str] = {
    "sim": "services.sim.service:PlantService",
    "wbc": "services.wbc.service:WbcService",
    "teleop": "services.teleop.scripted.service:ScriptedOperator",
    "cameras": "services.sim.rendering.cameras:CameraService",
}
"""What can be replayed: the name of a service and where its class is."""
SYNTHETIC = "services.teleop.synthetic.service:SyntheticOperator"
"""Goes by the name of teleop too, but plays no script."""
UNREPLAYABLE: Mapping[str, str] = {
    "keyboard": "a person's keys do not come over the bus",
}
LONGEST = 2**63


@dataclass(frozen=True)
class CheckOptions:
    """What to replay and how to judge it.

    Attributes:
        services: names; empty: all that can be.
        life: number of the life of each service; None: all there are.
        tolerance: see :class:`~common.runtime.replay.runner.ReplayRunner`.
        window: seconds since the life's first step between which outputs are compared.
        settings: laid over those recorded.
        out: log file for what was replayed; None: nowhere.
        verbose: let the services log.
    """

    services: tuple[str, ...] = ()
    life: int | None = None
    tolerance: float = 0.0
    window: tuple[float, float] = (0.0, float("inf"))
    settings: Mapping[str, Any] = field(default_factory=dict)
    out: Path | None = None
    verbose: bool = False


def recorded(path: Path) -> Iterator[Recorded]:
    """The messages of a log in the order of arrival; those under unknown keys are left out.

    Raises:
        LoggerError: the file cannot be read.
    """
    for entry in LogReader(path).raw_messages():
        if entry.topic is not None:
            yield Recorded(entry.topic, entry.payload, entry.tag, entry.log_time)


def runs_in(path: Path) -> list[ServiceRun]:
    """The lives in a log; what stands in the way of a replay is noted in each."""
    lives = find_runs(recorded(path))
    for life in lives:
        if life.service not in SERVICES:
            why = UNREPLAYABLE.get(life.service, "there is no service of this name to build")
            life.obstacle = life.obstacle or why
        elif not life.settings:
            life.obstacle = life.obstacle or "the log does not tell what it was built from"
    return lives


def build(life: ServiceRun, settings: Mapping[str, Any] | None = None) -> Service:
    """Build the service of a life again.

    Args:
        life: one of :func:`runs_in`.
        settings: laid over those recorded.

    Raises:
        ConfigError: there is something in the way of a replay, or the settings do not fit this
            version of the service.
    """
    if life.obstacle:
        raise ConfigError(f"it cannot be replayed: {life.obstacle}")
    try:
        recorded_settings = json.loads(life.settings)
    except json.JSONDecodeError as error:
        raise ConfigError(f"the recorded settings are no JSON: {error}") from error
    place = SERVICES[life.service]
    if life.service == "teleop" and "script" not in recorded_settings:
        place = SYNTHETIC
    module, _, name = place.partition(":")
    kind: type[Service] = getattr(importlib.import_module(module), name)
    return kind.from_settings(overlaid(recorded_settings, settings or {}))


class Checker:
    """Replays lives of one log, one after the other, and keeps what they say."""

    def __init__(self, path: Path, options: CheckOptions) -> None:
        """Check lives in the log ``path``."""
        self._path, self._options = path, options
        self._said: list[tuple[int, Topic[Any], bytes]] = []

    def check(self, life: ServiceRun, progress: Progress) -> Report:
        """Replay one life.

        Raises:
            TrillError: it cannot be replayed.
        """
        options, (start, _) = self._options, life.span_ns
        first, last = (
            min(LONGEST, start + round(1e9 * bound)) if bound != float("inf") else LONGEST
            for bound in options.window
        )
        with _quiet(enabled=not options.verbose):
            runner = ReplayRunner(
                build(life, options.settings),
                life,
                recorded(self._path),
                tolerance=options.tolerance,
                window_ns=(first, last),
                progress=progress,
                listener=None if options.out is None else self._hear,
            )
            return runner.run()

    def write(self) -> int:
        """Write what was said to ``options.out`` as a log; returns the number of messages.

        Raises:
            LoggerError: it cannot be written.
        """
        if self._options.out is None:
            return 0
        reader = LogReader(self._path)
        next(iter(reader.raw_messages()), None)
        robot = reader.origin.get("robot", "draco3")
        sink = McapSink(self._options.out, robot, LoggerConfig())
        for now, topic, payload in sorted(self._said, key=lambda item: item[0]):
            header = wire_header(payload)
            source = header.source if header else ""
            schema: type[Message] = topic.schema
            sample = RawSample(key_of(robot, topic, source), payload, schema_tag(schema), now)
            sink.write(sample, header)
        sink.close()
        return len(self._said)

    def _hear(self, topic: Topic[Any], payload: bytes, now_ns: int) -> None:
        self._said.append((now_ns, topic, payload))


def chosen(
    lives: Sequence[ServiceRun], services: Sequence[str], number: int | None
) -> list[ServiceRun]:
    """The lives to replay; all that can be, if no service is named.

    Raises:
        ConfigError: the log has no such service or life.
    """
    if not services:
        return [life for life in lives if not life.obstacle and number in (None, life.number)]
    found = []
    for service in services:
        of_service = [life for life in lives if life.service == service]
        wanted = [life for life in of_service if number in (None, life.number)]
        if not of_service:
            names = ", ".join(dict.fromkeys(life.service for life in lives))
            raise ConfigError(
                f"the log has no journal of {service!r}; "
                + (f"it has those of {names}" if names else "it has none at all")
            )
        if not wanted:
            raise ConfigError(
                f"expected a life of {service} from 1 to {len(of_service)}, got {number}"
            )
        found += wanted
    return found


def parse_settings(options: Sequence[str]) -> dict[str, Any]:
    """Turn ``path.to.key=value`` options into a nested table; values are JSON or else text.

    Raises:
        ConfigError: an option has no ``=``.
    """
    table: dict[str, Any] = {}
    for option in options:
        path, equals, text = option.partition("=")
        if not equals or not all(path.split(".")):
            raise ConfigError(f"expected KEY=VALUE such as tasks.torso.kp=90, got {option!r}")
        try:
            value = json.loads(text)
        except json.JSONDecodeError:
            value = text
        *parents, last = path.split(".")
        inner = table
        for parent in parents:
            inner = inner.setdefault(parent, {})
        inner[last] = value
    return table


@contextmanager
def _quiet(*, enabled: bool) -> Iterator[None]:
    """Keep services from logging again what they logged when they were recorded."""
    before = logging.root.manager.disable
    if enabled:
        logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(before)
