"""What a log is about: when, who, what, how much is missing, which episodes."""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.records import Channel

from common.errors import SchemaError
from common.schemas import EpisodeMark, LinkChange, Message
from common.topics import EPISODE, LINK_CHANGE, Topic
from common.wire.codec import decode
from services.logger.errors import LoggerError
from services.logger.log_format import (
    ACCOUNT_METADATA,
    EPISODE_METADATA,
    REPAIR_METADATA,
    START_METADATA,
)
from services.logger.read.episodes import COMPLETE, DISCARDED, Episode, EpisodeBook, merged
from services.logger.read.index import LogIndex, read_index
from services.logger.read.locks import is_locked
from services.logger.read.parts import existing_parts
from services.logger.read.restored import RebuiltMetadata
from services.logger.read.salvage import records_of
from services.logger.read.tally import KeyCount, Tally


@dataclass(frozen=True)
class PartInfo:
    """One file of a recording; ``origin`` is its first metadata record."""

    path: Path
    size: int
    messages: int
    whole: bool
    repaired: bool
    open: bool
    """Whether it is being recorded, or repaired, at this moment."""
    start_ns: int
    end_ns: int
    origin: dict[str, str]

    def wall_ns(self, monotonic_ns: int) -> int:
        """Wall-clock time [ns since 1970] of a time in this part; 0 if it is not known."""
        try:
            offset = int(self.origin["wall_ns"]) - int(self.origin["monotonic_ns"])
        except (KeyError, ValueError):
            return 0
        return monotonic_ns + offset


@dataclass(frozen=True)
class TopicInfo:
    """One key of a recording; ``rate`` is that of arrival [Hz], 0 if there are fewer than two."""

    key: str
    messages: int
    count: KeyCount
    schemas: tuple[str, ...]

    @property
    def rate(self) -> float:
        """Messages per second between its first and its last."""
        seconds = 1e-9 * (self.count.last_ns - self.count.first_ns)
        return (self.messages - 1) / seconds if seconds > 0 else 0.0


@dataclass(frozen=True)
class LinkInfo:
    """A change of a link, when it was told [ns, monotonic]."""

    at_ns: int
    change: LinkChange


@dataclass
class LogInfo:
    """Everything at once; the parts are in order."""

    parts: list[PartInfo]
    topics: list[TopicInfo] = field(default_factory=list)
    lives: dict[str, list[int]] = field(default_factory=dict)
    """The boots of each source, in the order in which they were heard of."""
    episodes: list[Episode] = field(default_factory=list)
    links: list[LinkInfo] = field(default_factory=list)

    @property
    def whole(self) -> bool:
        """Whether no part lacks its end."""
        return all(part.whole for part in self.parts)

    @property
    def origin(self) -> dict[str, str]:
        """How the recording was made."""
        return self.parts[0].origin

    def part_of(self, at_ns: int) -> PartInfo:
        """The part in which ``at_ns`` lies, or the last that began before."""
        return next((p for p in reversed(self.parts) if p.start_ns <= at_ns), self.parts[0])


def read_info(path: Path) -> LogInfo:
    """Look into the recording at ``path``, all its parts.

    Whole files are not read, only their index and the few messages that matter here; a file
    without its end is read through.

    Raises:
        LoggerError: there is no log.
    """
    indexes = [read_index(part) for part in existing_parts(path) if _has_content(part)]
    if not indexes:
        raise LoggerError(f"cannot open the log {path}: there is no such file, or it is empty")
    info = LogInfo([_part(index) for index in indexes])
    counts: dict[str, KeyCount] = {}
    for last in _lasts(info.parts, indexes):
        tally = _tally(last)
        for key, count in tally.report().items():
            counts[key] = _sum(counts[key], count) if key in counts else count
        for streams in tally.streams().values():
            for source, boot in streams:
                boots = info.lives.setdefault(source, [])
                if boot not in boots:
                    boots.append(boot)
    info.topics = _topics(indexes, counts)
    info.episodes = _episodes(info.parts, indexes)
    info.links = [
        LinkInfo(at_ns, change)
        for index in indexes
        for at_ns, change in _decoded(index, LINK_CHANGE)
        if isinstance(change, LinkChange)
    ]
    return info


def read_episodes(paths: Iterable[Path]) -> list[Episode]:
    """The episodes in the parts of a recording; a part that is no log has none."""
    indexes = []
    for path in paths:
        try:
            indexes.append(read_index(path))
        except LoggerError:
            continue
    return _episodes([_part(index) for index in indexes], indexes)


def _has_content(path: Path) -> bool:
    return not path.exists() or path.stat().st_size > 0


def _part(index: LogIndex) -> PartInfo:
    origins = index.named(START_METADATA)
    return PartInfo(
        path=index.path,
        size=index.size,
        messages=index.counts.total(),
        whole=index.whole,
        repaired=bool(index.named(REPAIR_METADATA)),
        open=not index.whole and is_locked(index.path),
        start_ns=index.start_ns,
        end_ns=index.end_ns,
        origin=origins[0] if origins else {},
    )


def _session(part: PartInfo) -> str:
    """What parts written by one process have in common."""
    return part.origin.get("session", str(part.path))


def _lasts(parts: Sequence[PartInfo], indexes: Sequence[LogIndex]) -> list[LogIndex]:
    """The last part of each process's; its account covers those before it."""
    return list({_session(p): i for p, i in zip(parts, indexes, strict=True)}.values())


def _tally(index: LogIndex) -> Tally:
    states = index.named(ACCOUNT_METADATA)
    if states:
        return Tally.from_state(states[-1])
    restored = RebuiltMetadata()
    channels: dict[int, Channel] = dict(index.channels)
    for record in records_of(index.path):
        restored.take(record, channels)
    return restored.tally


def _topics(indexes: Sequence[LogIndex], counts: dict[str, KeyCount]) -> list[TopicInfo]:
    messages: Counter[str] = Counter()
    schemas: dict[str, dict[str, None]] = {}
    for index in indexes:
        for number, channel in index.channels.items():
            messages[channel.topic] += index.counts[number]
            schema = index.schemas.get(channel.schema_id)
            names = schemas.setdefault(channel.topic, {})
            if schema is not None:
                names[schema.name] = None
    return [
        TopicInfo(key, messages[key], counts.get(key, KeyCount()), tuple(schemas.get(key, ())))
        for key in sorted({*messages, *counts})
    ]


def _episodes(parts: Sequence[PartInfo], indexes: Sequence[LogIndex]) -> list[Episode]:
    records: list[Episode] = []
    book = EpisodeBook()
    previous: PartInfo | None = None
    for part, index in zip(parts, indexes, strict=True):
        if previous is not None and _session(previous) != _session(part):
            # What happened while nobody recorded is not known.
            book.close(previous.end_ns)
        previous = part
        records += [Episode.from_metadata(values) for values in index.named(EPISODE_METADATA)]
        for at_ns, mark in _decoded(index, EPISODE):
            if isinstance(mark, EpisodeMark):
                book.observe(mark, at_ns)
    marked = [*book.finished, *([book.open] if book.open is not None else [])]
    # A part that was repaired alone calls interrupted what ends in a later one.
    ended = {one for one in marked if one.outcome in (COMPLETE, DISCARDED)}
    return merged([*records, *ended], marked)


def _decoded(index: LogIndex, topic: Topic[Any]) -> list[tuple[int, Message]]:
    """Messages of ``topic`` with their arrivals, as far as they can be read."""
    found: list[tuple[int, Message]] = []
    try:
        for channel, message in index.messages(lambda one: one.metadata.get("topic") == topic.name):
            tag = channel.metadata.get("schema_tag") or None
            try:
                found.append((message.log_time, decode(message.data, topic.schema, tag)))
            except SchemaError:
                continue
    except LoggerError:
        return found  # a damaged chunk: what could be read is true all the same
    return found


def _sum(one: KeyCount, other: KeyCount) -> KeyCount:
    return KeyCount(
        **{
            name: getattr(one, name) + getattr(other, name)
            for name in ("recorded", "dropped", "lost", "repeated", "late", "headerless")
        },
        earlier=one.earlier,
        bytes=one.bytes + other.bytes,
        first_ns=one.first_ns or other.first_ns,
        last_ns=other.last_ns or one.last_ns,
    )
