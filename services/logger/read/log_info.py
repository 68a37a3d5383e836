"""What is known of a recording without reading it through: see :mod:`services.logger.read.info`."""

from dataclasses import dataclass, field
from pathlib import Path

from common.operator.holds import Hold
from common.schemas import LinkChange
from services.logger.read.delivery import DeliveryCount
from services.logger.read.episodes import Episode
from services.logger.read.time_line import Pause


@dataclass(frozen=True)
class SegmentInfo:
    """One file of a recording.

    Attributes:
        path: of the file.
        size: of the file [bytes].
        messages: number of messages in it.
        whole: whether it has its end.
        repaired: whether `trill repair` wrote it.
        open: whether it is being recorded, or repaired, at this moment.
        readable: whether there is anything in it that a repair could save.
        start_ns: arrival of the first message, on the recording's clock [ns].
        end_ns: arrival of the last message, on the recording's clock [ns].
        shift_ns: the recording's clock minus the segment's monotonic clock [ns].
        wall_offset_ns: wall clock minus the segment's monotonic clock [ns]; None: not known.
        origin: how the recording was made, from the file's first metadata record.
    """

    path: Path
    size: int
    messages: int
    whole: bool
    repaired: bool
    open: bool
    start_ns: int
    end_ns: int
    shift_ns: int
    wall_offset_ns: int | None
    origin: dict[str, str]
    readable: bool = True

    @property
    def session(self) -> str:
        """Id that the segments written by one process have in common."""
        return self.origin.get("session", str(self.path))

    def wall_ns(self, time_ns: int) -> int:
        """Convert from the recording's clock to the wall clock [ns since 1970]; 0: not known."""
        if self.wall_offset_ns is None:
            return 0
        return time_ns - self.shift_ns + self.wall_offset_ns


@dataclass(frozen=True)
class TopicInfo:
    """One key of a recording.

    Attributes:
        key: Zenoh key.
        messages: number of messages in the files.
        count: delivery counts; times are on the recording's clock.
        schemas: names of the schemas.
        seconds: time from the first to the last message, added up over the sessions [s].
        sessions: number of sessions that recorded messages of it.
    """

    key: str
    messages: int
    count: DeliveryCount
    schemas: tuple[str, ...]
    seconds: float = 0.0
    sessions: int = 1

    @property
    def rate(self) -> float:
        """Arrivals per second while it was recorded [Hz]; 0 for fewer than two."""
        return (self.messages - self.sessions) / self.seconds if self.seconds > 0 else 0.0


@dataclass(frozen=True)
class LinkInfo:
    """A change of an injected link, with the arrival of its message, recording's clock [ns]."""

    at_ns: int
    change: LinkChange


@dataclass
class LogInfo:
    """Summary of a recording.

    Attributes:
        segments: its files, in order.
        topics: its keys, in alphabetical order.
        boots: boot ids of each service, in order of appearance.
        episodes: in order of start.
        holds: who had the robot, in order; times are arrivals on the recording's clock [ns].
        links: changes of injected links, in order.
        pauses: where nobody recorded for long.
        remarks: what else a reader should know, a sentence each.
    """

    segments: list[SegmentInfo]
    topics: list[TopicInfo] = field(default_factory=list)
    boots: dict[str, list[int]] = field(default_factory=dict)
    episodes: list[Episode] = field(default_factory=list)
    holds: list[Hold] = field(default_factory=list)
    links: list[LinkInfo] = field(default_factory=list)
    pauses: list[Pause] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    @property
    def seconds(self) -> float:
        """Time from the first message to the last on the recording's clock [s]."""
        filled = [segment for segment in self.segments if segment.messages]
        return 1e-9 * (filled[-1].end_ns - filled[0].start_ns) if filled else 0.0

    @property
    def whole(self) -> bool:
        """Whether every segment has its end."""
        return all(segment.whole for segment in self.segments)

    @property
    def origin(self) -> dict[str, str]:
        """How the recording was made."""
        return self.segments[0].origin
