"""Replays runs of services from a log: connects the logger's reader to the replay runner."""

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
from common.transport.config import BusConfig
from common.transport.keys import key_of
from common.transport.tap import RawSample
from common.wire.codec import schema_tag
from common.wire.header import wire_header
from services.logger.read.info import read_info
from services.logger.read.reader import LogReader
from services.logger.record.config import LoggerConfig
from services.logger.record.sink import McapSink

SERVICES: Mapping[str, str] = {
    "sim": "services.sim.service:PlantService",
    "wbc": "services.wbc.service:WbcService",
    "teleop": "services.teleop.scripted.service:ScriptedOperator",
    "cameras": "services.sim.rendering.cameras:CameraService",
    "policy": "services.policy.service:PolicyOperator",
}
"""Services that can be replayed, and where their classes are."""
SYNTHETIC = "services.teleop.synthetic.service:SyntheticOperator"
"""Publishes as teleop too, but its settings name no script."""
UNREPLAYABLE: Mapping[str, str] = {
    "keyboard": "a person's keys do not come over the bus",
    "headset": "what its pages send does not come over the bus",
}
"""Services that cannot be replayed, and why."""
_MAX_NS = 2**63
_AHEAD_NS = 10_000_000_000
"""No message that a run took in was recorded longer before its own first one [ns]."""


@dataclass(frozen=True)
class CheckOptions:
    """What to replay and how to judge it.

    Attributes:
        services: names; empty: all that can be replayed.
        run: number of the run of each service; None: all.
        tolerance: see :class:`~common.runtime.replay.runner.ReplayRunner`.
        window: outputs between these times since the run's first step are compared [s].
        settings: override the recorded ones.
        out: log file for the replayed outputs; None: none is written.
        verbose: let the services log.
    """

    services: tuple[str, ...] = ()
    run: int | None = None
    tolerance: float = 0.0
    window: tuple[float, float] = (0.0, float("inf"))
    settings: Mapping[str, Any] = field(default_factory=dict)
    out: Path | None = None
    verbose: bool = False


def recorded(path: Path, since_ns: int = 0) -> Iterator[Recorded]:
    """Yield the messages of a log in the order of arrival, except those under unknown keys.

    With ``since_ns``, on the recording's clock, most of those that arrived before are left out.

    Raises:
        LoggerError: the file cannot be read.
    """
    for raw in LogReader(path).raw_messages(since_ns=since_ns):
        if raw.topic is not None:
            yield Recorded(raw.topic, raw.payload, raw.tag, raw.time_ns)


def runs_in(path: Path) -> list[ServiceRun]:
    """Return the runs in a log; ``obstacle`` of each says why it cannot be replayed."""
    runs = find_runs(recorded(path))
    for run in runs:
        if run.service not in SERVICES:
            why = UNREPLAYABLE.get(run.service, "no service of this name can be built")
            run.obstacle = run.obstacle or why
        elif not run.settings:
            run.obstacle = run.obstacle or "the log does not have its settings"
    return runs


def build(run: ServiceRun, settings: Mapping[str, Any] | None = None) -> Service:
    """Build the service of a run, one of :func:`runs_in`, from its recorded settings.

    ``settings`` override them.

    Raises:
        ConfigError: the run cannot be replayed, or the settings do not fit this version of the
            service.
    """
    if run.obstacle:
        raise ConfigError(f"it cannot be replayed: {run.obstacle}")
    try:
        recorded_settings = json.loads(run.settings)
    except json.JSONDecodeError as error:
        raise ConfigError(f"the recorded settings are no JSON: {error}") from error
    place = SERVICES[run.service]
    if run.service == "teleop" and "script" not in recorded_settings:
        place = SYNTHETIC
    module, _, name = place.partition(":")
    kind: type[Service] = getattr(importlib.import_module(module), name)
    return kind.from_settings(overlaid(recorded_settings, settings or {}))


class Checker:
    """Replays runs of one log, one after the other, and keeps their outputs."""

    def __init__(self, path: Path, options: CheckOptions) -> None:
        """Check runs in the log ``path``."""
        self._path, self._options = path, options
        self._outputs: list[tuple[int, Topic[Any], bytes]] = []

    def check(self, run: ServiceRun, on_progress: Progress) -> Report:
        """Replay one run.

        Raises:
            TrillError: it cannot be replayed.
        """
        options, (start, _) = self._options, run.span_ns
        first, last = (
            min(_MAX_NS, start + round(1e9 * bound)) if bound != float("inf") else _MAX_NS
            for bound in options.window
        )
        with _quiet(enabled=not options.verbose):
            runner = ReplayRunner(
                build(run, options.settings),
                run,
                recorded(self._path, run.begin_ns - _AHEAD_NS),
                tolerance=options.tolerance,
                window_ns=(first, last),
                on_progress=on_progress,
                on_message=None if options.out is None else self._keep,
            )
            return runner.run()

    def write(self) -> int:
        """Write the outputs to ``options.out`` as a log; return the number of messages.

        Raises:
            LoggerError: it cannot be written.
        """
        if self._options.out is None:
            return 0
        robot = read_info(self._path).origin.get("robot", BusConfig().robot)
        sink = McapSink(self._options.out, robot, LoggerConfig())
        for now, topic, payload in sorted(self._outputs, key=lambda item: item[0]):
            header = wire_header(payload)
            source = header.source if header else ""
            schema: type[Message] = topic.schema
            sample = RawSample(key_of(robot, topic, source), payload, schema_tag(schema), now)
            sink.write(sample, header)
        sink.close()
        return len(self._outputs)

    def _keep(self, topic: Topic[Any], payload: bytes, now_ns: int) -> None:
        self._outputs.append((now_ns, topic, payload))


def select_runs(
    runs: Sequence[ServiceRun], services: Sequence[str], number: int | None
) -> list[ServiceRun]:
    """Return the runs to replay: of ``services``, or if none is named all that can be replayed.

    Raises:
        ConfigError: the log has no such service or run.
    """
    if not services:
        return [run for run in runs if not run.obstacle and number in (None, run.number)]
    found = []
    for service in services:
        of_service = [run for run in runs if run.service == service]
        wanted = [run for run in of_service if number in (None, run.number)]
        if not of_service:
            names = ", ".join(dict.fromkeys(run.service for run in runs))
            raise ConfigError(
                f"the log has no journal of {service!r}; "
                + (f"it has those of {names}" if names else "it has none at all")
            )
        if not wanted:
            raise ConfigError(
                f"expected a run of {service} from 1 to {len(of_service)}, got {number}"
            )
        found += wanted
    return found


def parse_settings(options: Sequence[str]) -> dict[str, Any]:
    """Convert ``path.to.key=value`` options to a nested table; values are JSON or else text.

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
    """Suppress what the services log, which they logged during the recording too."""
    before = logging.root.manager.disable
    if enabled:
        logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(before)
