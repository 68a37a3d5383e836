"""Publishes a log back on the bus: the recorded bytes at the recorded pace, for viewers.

A recorded command must never reach a live robot. So everything goes out under another robot's
name, and under any name only if nobody of that name is heard on the bus, before and meanwhile.
"""

import argparse
import fnmatch
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import zenoh
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn

from common.errors import ConfigError
from common.topics import ALL_TOPICS, Priority
from common.transport.config import BusConfig, bus_of
from common.transport.publisher import PRIORITIES
from common.transport.session import open_session, wire_encoding
from common.transport.tap import RawTap
from deploy.process import terminated_as_interrupted
from lab.errors import LabError
from services.logger.read.reader import LogReader, RecordedMessage

SERVICE = "replay"
"""Its place in the port table."""
SUFFIX = "-replay"
LISTENING = 1.5
"""Time in which a live robot of the chosen name would be heard; its services report twice a
second [s]."""
_LATE = 0.05
_LONGEST_SLEEP = 0.1


@dataclass(frozen=True)
class PlayOptions:
    """What to publish and where.

    Attributes:
        bus: where; its robot's name counts only if ``named``.
        named: publish as ``bus.robot``, not as the recorded robot's name and a suffix.
        speed: of the recording's.
        loop: over and over.
        window: of the recording [s].
        topics: patterns of topic names; empty: all.
    """

    bus: BusConfig = field(default_factory=BusConfig)
    named: bool = False
    speed: float = 1.0
    loop: bool = False
    window: tuple[float, float] = (0.0, float("inf"))
    topics: tuple[str, ...] = ()

    @classmethod
    def from_arguments(cls, arguments: argparse.Namespace) -> Self:
        """Take the options of ``trill replay``.

        Raises:
            ConfigError: a name, port or pattern is wrong.
        """
        bus = bus_of(arguments.base_port, arguments.config, arguments.robot)
        if arguments.connect:
            bus = bus.model_copy(update={"mode": "client", "connect": arguments.connect})
        for pattern in arguments.topics:
            if not any(fnmatch.fnmatchcase(topic.name, pattern) for topic in ALL_TOPICS):
                names = ", ".join(topic.name for topic in ALL_TOPICS)
                raise ConfigError(f"--topics: no topic matches {pattern!r}; there are {names}")
        return cls(
            bus,
            arguments.robot is not None,
            arguments.speed,
            arguments.loop,
            (arguments.start, arguments.end),
            arguments.topics,
        )


@dataclass(frozen=True)
class Extent:
    """What a log holds, as far as it matters here: its robot and its time [ns]."""

    robot: str
    start_ns: int
    end_ns: int

    @property
    def seconds(self) -> float:
        """From the first message to the last [s]."""
        return 1e-9 * (self.end_ns - self.start_ns)


def extent_of(path: Path) -> Extent:
    """Read a log through.

    Raises:
        LoggerError: the file cannot be read.
        LabError: it holds no message.
    """
    reader = LogReader(path)
    start: int | None = None
    end = 0
    for entry in reader.raw_messages():
        start = entry.log_time if start is None else min(start, entry.log_time)
        end = max(end, entry.log_time)
    if start is None:
        raise LabError(f"{path} holds no message; there is nothing to play")
    return Extent(reader.origin.get("robot", BusConfig().robot), start, end)


class Player:
    """Publishes the messages of a log on an open session."""

    def __init__(self, session: Any, path: Path, extent: Extent, options: PlayOptions) -> None:
        """Prepare; ``options.bus.robot`` is the name to publish under."""
        self.sent = 0
        self.late = 0
        """Messages that went out more than 50 ms late: this machine cannot keep the pace."""
        self._session, self._path = session, path
        self._extent, self._options = extent, options
        self._publishers: dict[tuple[str, str], Any] = {}

    def play(self) -> Iterator[float]:
        """Publish from the first message to the last; yields the time in the recording [s].

        Yields often enough, also while nothing is due, that whoever drives it can do other things.
        """
        began = looked = time.monotonic()
        first, last = self._options.window
        for entry in LogReader(self._path).raw_messages():
            place = 1e-9 * (entry.log_time - self._extent.start_ns)
            if place > last:
                break
            if time.monotonic() - looked > _LONGEST_SLEEP:
                looked = time.monotonic()
                yield max(first, place)
            if place < first:
                began = time.monotonic()  # the way to the window is not lateness
                continue
            if not self._chosen(entry):
                continue
            due = began + (place - first) / self._options.speed
            while (wait := due - time.monotonic()) > 0.0:
                yield max(first, place - wait * self._options.speed)
                time.sleep(min(wait, _LONGEST_SLEEP))
            self.late += wait < -_LATE
            self._publish(entry)
            yield place

    def _chosen(self, entry: RecordedMessage) -> bool:
        patterns = self._options.topics
        name = entry.topic.name if entry.topic else self._tail(entry)
        return not patterns or any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns)

    def _tail(self, entry: RecordedMessage) -> str:
        """The key without the robot's name."""
        return entry.key.removeprefix(f"{self._extent.robot}/")

    def _publish(self, entry: RecordedMessage) -> None:
        publisher = self._publishers.get((entry.key, entry.tag))
        if publisher is None:
            priority = entry.topic.priority if entry.topic else Priority.INTERACTIVE
            publisher = self._session.declare_publisher(
                f"{self._options.bus.robot}/{self._tail(entry)}",
                encoding=wire_encoding(entry.tag),
                priority=PRIORITIES[priority],
                express=priority is not Priority.BULK,
                congestion_control=zenoh.CongestionControl.DROP,
                reliability=zenoh.Reliability.RELIABLE,
                allowed_destination=zenoh.Locality.REMOTE,
            )
            self._publishers[entry.key, entry.tag] = publisher
        publisher.put(entry.payload)
        self.sent += 1


class Watchdog:
    """Hears whether anybody else publishes under a robot's name."""

    def __init__(self, session: Any, robot: str) -> None:
        """Listen under ``robot`` to everything but our own."""
        self._robot = robot
        self._tap = RawTap(session, robot, maxlen=1)

    def check(self) -> None:
        """See whether anybody was heard.

        Raises:
            LabError: somebody was.
        """
        heard = self._tap.drain()
        if heard:
            raise LabError(
                f"somebody publishes {heard[-1].key} on this bus: a recording must not reach a "
                f"live robot, so nothing is published as {self._robot!r}; leave --as away, or "
                "choose another name or --base-port"
            )

    def listen(self, seconds: float) -> None:
        """Check for a while.

        Raises:
            LabError: somebody was heard.
        """
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.check()
            time.sleep(0.05)
        self.check()


def play(path: Path, options: PlayOptions) -> int:
    """Publish a log until its end, or until Ctrl-C; returns the exit code.

    Raises:
        LoggerError: the log cannot be read.
        BusError: the bus cannot be opened.
        LabError: the log is empty, or somebody of the chosen name is on the bus.
        ConfigError: the window begins after the log's end.
    """
    extent = extent_of(path)
    if options.window[0] > extent.seconds:
        raise ConfigError(
            f"--from: expected at most {extent.seconds:.1f}, since {path} lasts so many seconds; "
            f"got {options.window[0]:g}"
        )
    if not options.named:
        named = {"robot": f"{extent.robot}{SUFFIX}"[:64]}
        options = replace(options, bus=options.bus.model_copy(update=named))
    player: Player | None = None
    try:
        with terminated_as_interrupted():
            session: Any = open_session(options.bus, SERVICE)
            try:
                watchdog = Watchdog(session, options.bus.robot)
                watchdog.listen(LISTENING)
                player = Player(session, path, extent, options)
                _play(player, watchdog, extent, options)
            finally:
                session.close()
    except KeyboardInterrupt:
        pass
    if player is not None:
        print(f"{player.sent} messages published as {options.bus.robot}, {player.late} late")
    return 0


def _play(player: Player, watchdog: Watchdog, extent: Extent, options: PlayOptions) -> None:
    """Drive the player, watch the bus, show where it is."""
    bus = options.bus
    where = (
        f"as a client of {', '.join(bus.connect or ())}"
        if bus.mode == "client"
        else (f"base port {bus.base_port}")
    )
    print(
        f"publishing as {bus.robot}, {where}; watch: trill top --robot {bus.robot}"
        + ("" if bus.mode == "client" else f" --base-port {bus.base_port}"),
        flush=True,
    )
    first, last = options.window
    last = min(last, extent.seconds)
    with _bar() as bar:
        task: TaskID = bar.add_task("", total=max(last - first, 1e-9))
        while True:
            for place in player.play():
                watchdog.check()
                bar.update(task, completed=place - first, description=f"{place:.1f} s")
            if not options.loop:
                return
            time.sleep(0.01)  # an empty window must not spin


def _bar() -> Progress:
    """A bar on standard error, if that is a terminal."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn())
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
