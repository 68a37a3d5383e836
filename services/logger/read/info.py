"""Summarises a log: when, who, what, how much is missing, which episodes."""

import contextlib
import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from common.errors import SchemaError
from common.schemas import EpisodeMark, LinkChange, Message
from common.topics import EPISODE, LINK_CHANGE, Topic
from common.wire.codec import decode
from services.logger.errors import LoggerError
from services.logger.log_format import (
    CARRIED_METADATA,
    DELIVERY_METADATA,
    END_METADATA,
    REPAIR_METADATA,
    START_METADATA,
)
from services.logger.read.delivery import DeliveryCount, DeliveryStats
from services.logger.read.episodes import Episode, EpisodeBook
from services.logger.read.holds import read_holds
from services.logger.read.index import LogIndex, read_index
from services.logger.read.locks import is_locked
from services.logger.read.log_info import LinkInfo, LogInfo, SegmentInfo, TopicInfo
from services.logger.read.mcap_file import open_mcap
from services.logger.read.rebuild import DeliveryRebuilder
from services.logger.read.recovery import recover
from services.logger.read.segments import find_segments
from services.logger.read.time_line import TimeLine


def read_info(path: Path) -> LogInfo:
    """Summarise the recording at ``path`` with all its segments.

    Of whole files only the index and the few messages that matter here are read; a file without
    its end is read through.

    Raises:
        LoggerError: there is no log.
    """
    found = find_segments(path)
    paths = [one for one in found.paths if not one.exists() or one.stat().st_size]
    indexes = [read_index(one) for one in paths]
    if not indexes:
        raise LoggerError(f"{path} is not an MCAP log: it is empty")
    line = TimeLine()
    info = LogInfo([_segment_info(index, line) for index in indexes], remarks=found.remarks())
    info.pauses = line.pauses
    counts: dict[str, list[DeliveryCount]] = {}
    # The statistics in a process's last segment cover those before it.
    last_of_session = {s.session: (s, i) for s, i in zip(info.segments, indexes, strict=True)}
    for segment, index in last_of_session.values():
        delivery = _delivery_stats(index)
        for key, count in delivery.report().items():
            times = (count.first_ns + segment.shift_ns, count.last_ns + segment.shift_ns)
            first_ns, last_ns = times if count.last_ns else (0, 0)
            placed = replace(count, first_ns=first_ns, last_ns=last_ns)
            counts.setdefault(key, []).append(placed)
        for streams in delivery.streams().values():
            for source, boot in streams:
                boots = info.boots.setdefault(source, [])
                if boot not in boots:
                    boots.append(boot)
    info.topics = _topics(indexes, counts)
    info.episodes = _episodes(info.segments, indexes)
    info.holds = read_holds(
        [(index, segment.shift_ns) for segment, index in zip(info.segments, indexes, strict=True)]
    )
    info.links = [
        LinkInfo(at_ns + segment.shift_ns, change)
        for segment, index in zip(info.segments, indexes, strict=True)
        for at_ns, change in _decoded(index, LINK_CHANGE)
        if isinstance(change, LinkChange)
    ]
    return info


def read_episodes(paths: Iterable[Path]) -> list[Episode]:
    """Return the episodes in the segments of a recording; a file that is no log has none."""
    indexes = []
    for path in paths:
        try:
            indexes.append(read_index(path))
        except LoggerError:
            continue
    line = TimeLine()
    return _episodes([_segment_info(index, line) for index in indexes], indexes)


def _segment_info(index: LogIndex, line: TimeLine) -> SegmentInfo:
    origin = next(iter(index.metadata_named(START_METADATA)), {})
    start_ns = end_ns = 0
    if index.places:
        line.begin_segment(index.path.name, origin)
        start_ns, end_ns = line.place(index.start_ns), line.place(index.end_ns)
    return SegmentInfo(
        path=index.path,
        size=index.size,
        messages=index.counts.total(),
        whole=index.whole,
        repaired=bool(index.metadata_named(REPAIR_METADATA)),
        open=not index.whole and is_locked(index.path),
        start_ns=start_ns,
        end_ns=end_ns,
        shift_ns=line.shift_ns,
        wall_offset_ns=line.wall_offset_ns,
        origin=origin,
        readable=index.whole or bool(index.places) or _is_readable(index.path),
    )


def _is_readable(path: Path) -> bool:
    with open_mcap(path) as file:
        return next(recover(file), None) is not None


def _delivery_stats(index: LogIndex) -> DeliveryStats:
    """Return the statistics that the log states, or rebuild them from its messages."""
    stated = index.metadata_named(DELIVERY_METADATA)
    if stated:
        return DeliveryStats.from_metadata(stated[-1])
    rebuilt = DeliveryRebuilder()
    rebuilt.channels.update(index.channels)
    with open_mcap(index.path) as file:
        for _, record in recover(file):
            rebuilt.add(record)
    return rebuilt.stats


def _topics(
    indexes: Sequence[LogIndex], counts: Mapping[str, Sequence[DeliveryCount]]
) -> list[TopicInfo]:
    """Return the topics; ``counts`` has those of each session by key."""
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
        TopicInfo(
            key,
            messages[key],
            _added(counts.get(key, ())),
            tuple(schemas.get(key, ())),
            seconds=1e-9 * sum(one.last_ns - one.first_ns for one in counts.get(key, ())),
            sessions=len(counts.get(key, ())),
        )
        for key in sorted({*messages, *counts})
    ]


def _added(sessions: Sequence[DeliveryCount]) -> DeliveryCount:
    if not sessions:
        return DeliveryCount()
    # Before a later session were mostly messages that an earlier one recorded.
    return replace(sum(sessions, DeliveryCount()), earlier=sessions[0].earlier)


def _episodes(segments: Sequence[SegmentInfo], indexes: Sequence[LogIndex]) -> list[Episode]:
    """Follow the marks through all segments."""
    book = EpisodeBook()
    previous: SegmentInfo | None = None
    for segment, index in zip(segments, indexes, strict=True):
        if previous is None:
            book.open = _carried_episode(index)
        elif previous.session != segment.session:
            # What happened while nobody recorded is not known.
            book.close(previous.end_ns)
        previous = segment
        for at_ns, mark in _decoded(index, EPISODE):
            if isinstance(mark, EpisodeMark):
                book.observe(mark, at_ns + segment.shift_ns)
        for end in index.metadata_named(END_METADATA):
            with contextlib.suppress(ValueError, KeyError):
                book.close(int(end["monotonic_ns"]) + segment.shift_ns)
    if previous is not None and previous.repaired:
        book.close(previous.end_ns)
    return book.finished if book.open is None else [*book.finished, book.open]


def _carried_episode(index: LogIndex) -> Episode | None:
    """Return the episode that was open when an earlier segment, not read here, ended."""
    for carried in index.metadata_named(CARRIED_METADATA):
        with contextlib.suppress(ValueError, KeyError, TypeError):
            return Episode(**json.loads(carried["open_episode"]))
    return None


def _decoded(index: LogIndex, topic: Topic[Any]) -> list[tuple[int, Message]]:
    """Return the readable messages of ``topic`` with their arrivals."""
    found: list[tuple[int, Message]] = []
    try:
        for channel, message in index.messages(lambda one: one.metadata.get("topic") == topic.name):
            tag = channel.metadata.get("schema_tag") or None
            try:
                found.append((message.log_time, decode(message.data, topic.schema, tag)))
            except SchemaError:
                continue
    except LoggerError:
        return found  # the messages before a damaged chunk are right all the same
    return found
