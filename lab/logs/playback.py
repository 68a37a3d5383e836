"""Publishes a log on the bus, the recorded bytes at the recorded pace, for viewers.

A recorded command must never reach a live robot. Therefore everything is published under another
robot's name, and only while no other publisher of that name is heard on the bus.
"""

import fnmatch
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import zenoh

from common.errors import ConfigError
from common.program import signals_as_keyboard_interrupt
from common.topics import ALL_TOPICS, Priority
from common.transport.config import BusConfig
from common.transport.publisher import PRIORITIES
from common.transport.session import open_session, wire_encoding
from common.transport.tap import RawTap
from lab.errors import LabError
from lab.progress import ProgressBar
from services.logger.read.info import read_info
from services.logger.read.reader import LogReader, RecordedMessage
from services.logger.read.time_line import Pause

SERVICE = "replay"
"""Name in the port table."""
SUFFIX = "-replay"
LISTENING = 1.5
"""Time to listen for a live robot of the chosen name; its services report twice a second [s]."""
_LATE = 0.05
_LONGEST_SLEEP = 0.1


@dataclass(frozen=True)
class PlayOptions:
    """What to publish and where.

    Attributes:
        bus: the bus; its robot's name is used only if ``named``.
        named: publish as ``bus.robot``, not as the recorded robot's name and a suffix.
        speed: relative to the recording.
        loop: repeat until interrupted.
        window: span of the recording [s].
        topics: patterns of topic names; empty: all.
    """

    bus: BusConfig = field(default_factory=BusConfig)
    named: bool = False
    speed: float = 1.0
    loop: bool = False
    window: tuple[float, float] = (0.0, float("inf"))
    topics: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for pattern in self.topics:
            if not any(fnmatch.fnmatchcase(topic.name, pattern) for topic in ALL_TOPICS):
                names = ", ".join(topic.name for topic in ALL_TOPICS)
                raise ConfigError(f"--topics: no topic matches {pattern!r}; there are {names}")


@dataclass(frozen=True)
class Extent:
    """Robot of a log, arrival of its first and last message, recording's clock [ns], its pauses."""

    robot: str
    start_ns: int
    end_ns: int
    pauses: tuple[Pause, ...] = ()

    @property
    def seconds(self) -> float:
        """Time from the first message to the last [s]."""
        return 1e-9 * (self.end_ns - self.start_ns)


def extent_of(path: Path) -> Extent:
    """Return the extent of a log.

    Raises:
        LoggerError: the file cannot be read.
        LabError: it holds no message.
    """
    info = read_info(path)
    segments = [segment for segment in info.segments if segment.messages]
    if not segments:
        raise LabError(f"{path} holds no message; there is nothing to publish")
    robot = info.origin.get("robot", BusConfig().robot)
    return Extent(robot, segments[0].start_ns, segments[-1].end_ns, tuple(info.pauses))


class Player:
    """Publishes the messages of a log on an open session."""

    def __init__(self, session: Any, path: Path, extent: Extent, options: PlayOptions) -> None:
        """Prepare to publish as ``options.bus.robot``."""
        self.sent = 0
        self.late = 0
        """Number of messages published more than 50 ms late, because this machine is too slow."""
        self._session, self._path = session, path
        self._extent, self._options = extent, options
        self._publishers: dict[tuple[str, str], Any] = {}

    def play(self) -> Iterator[float]:
        """Publish from the first message to the last; yield the time in the recording [s].

        It yields every 0.1 s even while no message is due.
        """
        began = looked = time.monotonic()
        first, last = self._options.window
        for raw in LogReader(self._path).raw_messages():
            place = 1e-9 * (raw.time_ns - self._extent.start_ns)
            if place > last:
                break
            if time.monotonic() - looked > _LONGEST_SLEEP:
                looked = time.monotonic()
                yield max(first, place)
            if place < first:
                began = time.monotonic()  # reading up to the window makes nothing late
                continue
            if not self._is_selected(raw):
                continue
            due = began + (place - first) / self._options.speed
            while (wait := due - time.monotonic()) > 0.0:
                yield max(first, place - wait * self._options.speed)
                time.sleep(min(wait, _LONGEST_SLEEP))
            self.late += wait < -_LATE
            self._publish(raw)
            yield place

    def _is_selected(self, raw: RecordedMessage) -> bool:
        patterns = self._options.topics
        name = raw.topic.name if raw.topic else self._key_in_robot(raw)
        return not patterns or any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns)

    def _key_in_robot(self, raw: RecordedMessage) -> str:
        """Return the key without the robot's name."""
        return raw.key.removeprefix(f"{self._extent.robot}/")

    def _publish(self, raw: RecordedMessage) -> None:
        publisher = self._publishers.get((raw.key, raw.tag))
        if publisher is None:
            priority = raw.topic.priority if raw.topic else Priority.INTERACTIVE
            publisher = self._session.declare_publisher(
                f"{self._options.bus.robot}/{self._key_in_robot(raw)}",
                encoding=wire_encoding(raw.tag),
                priority=PRIORITIES[priority],
                express=priority is not Priority.BULK,
                congestion_control=zenoh.CongestionControl.DROP,
                reliability=zenoh.Reliability.RELIABLE,
                allowed_destination=zenoh.Locality.REMOTE,
            )
            self._publishers[raw.key, raw.tag] = publisher
        publisher.put(raw.payload)
        self.sent += 1


class NameMonitor:
    """Detects whether another process publishes under a robot's name."""

    def __init__(self, session: Any, robot: str) -> None:
        """Listen to everything under ``robot`` except what ``session`` itself publishes."""
        self._robot = robot
        self._tap = RawTap(session, robot, maxlen=1)

    def check(self) -> None:
        """Check what was heard since the last check.

        Raises:
            LabError: another process published under this name.
        """
        heard = self._tap.drain()
        if heard:
            raise LabError(
                f"another process publishes {heard[-1].key} on this bus: a recording must not "
                f"reach a live robot, so nothing is published as {self._robot!r}; leave out --as, "
                "or choose another name or --base-port"
            )

    def listen(self, seconds: float) -> None:
        """Check for ``seconds``.

        Raises:
            LabError: another process published under this name.
        """
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.check()
            time.sleep(0.05)
        self.check()


def play(path: Path, options: PlayOptions) -> int:
    """Publish a log until its end, or until Ctrl-C; return the exit code.

    Raises:
        LoggerError: the log cannot be read.
        BusError: the bus cannot be opened.
        LabError: the log is empty, or a robot of the chosen name is on the bus.
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
        with signals_as_keyboard_interrupt():
            session: Any = open_session(options.bus, SERVICE)
            try:
                monitor = NameMonitor(session, options.bus.robot)
                monitor.listen(LISTENING)
                player = Player(session, path, extent, options)
                _play(player, monitor, extent, options)
            finally:
                session.close()
    except KeyboardInterrupt:
        pass
    if player is not None:
        print(f"{player.sent} messages published as {options.bus.robot}, {player.late} late")
    return 0


def _play(player: Player, monitor: NameMonitor, extent: Extent, options: PlayOptions) -> None:
    """Publish, watch the bus for a live robot, and show the progress."""
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
    for pause in extent.pauses:
        print(f"at {1e-9 * (pause.at_ns - extent.start_ns):.1f} s: {pause}", flush=True)
    first, last = options.window
    last = min(last, extent.seconds)
    with ProgressBar(f"publishing {bus.robot}", max(last - first, 1e-9)) as bar:
        while True:
            for place in player.play():
                monitor.check()
                bar.show(place - first, text=f"{place:.1f} s")
            if not options.loop:
                return
            time.sleep(0.01)  # an empty window must not spin
