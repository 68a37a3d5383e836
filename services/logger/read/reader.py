"""Reads the messages of a log in order, also of a log whose writer was killed."""

from collections import Counter
from collections.abc import Container, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Channel, McapRecord, Metadata
from mcap.records import Message as McapMessage

from common.errors import SchemaError
from common.schemas import Message
from common.topics import ALL_TOPICS, Topic
from common.wire.decoder import Decoders
from services.logger.errors import DamagedLogError, LoggerError
from services.logger.log_format import DELIVERY_METADATA, START_METADATA
from services.logger.read.delivery import DeliveryCount, DeliveryStats
from services.logger.read.index import LogIndex, read_index
from services.logger.read.mcap_file import MAGIC, UNREADABLE, McapFile, Span, open_mcap
from services.logger.read.segments import existing_segments
from services.logger.read.time_line import TimeLine

_TOPICS: dict[str, Topic[Any]] = {topic.name: topic for topic in ALL_TOPICS}
_Channel = tuple[str, Topic[Any] | None, str]
"""Key, topic and schema tag of a channel's messages."""


class RecordedMessage(NamedTuple):
    """One message of a log, still encoded as on the wire.

    Attributes:
        key: Zenoh key it was published under.
        topic: its row of the topic table; None for a key that was not in the table when it was
            recorded, or no longer is.
        tag: schema tag given by the sender; empty if none.
        payload: the bytes.
        log_time: arrival at the logger, monotonic clock [ns].
        time_ns: the same on the recording's clock, which is one for all segments [ns]; see
            :mod:`services.logger.read.time_line`.
        publish_time: sending, monotonic clock of the sender's host [ns].
        sequence: sequence number of its stream, modulo 2^32.
    """

    key: str
    topic: Topic[Any] | None
    tag: str
    payload: bytes
    log_time: int
    time_ns: int
    publish_time: int
    sequence: int


class LogReader:
    """Iterates over the messages of a log in the order of arrival.

    The segments of a recording that was rotated or interrupted are read as one log.

    The attributes below, except ``path``, are complete once an iteration has ended.

    Attributes:
        path: the file, or the first of its segments.
        truncated: whether a segment lacks its end, as it does when the logger was killed.
        refused: number of messages that did not fit today's schema, by topic name.
        last_refusal: why the last of them did not.
        origin: how the segment being read was made.
        time_line: the recording's clock, at the segment being read.
        report: the logger's own counts by key; empty if it was killed.
        start_ns: arrival of the first message, on the recording's clock [ns]; None without any.
        end_ns: arrival of the last message so far [ns]; that of its chunk is known from its start.
    """

    def __init__(self, path: Path) -> None:
        """Name the file; each iteration opens it."""
        self.path = path
        self.truncated = False
        self.refused: Counter[str] = Counter()
        self.last_refusal = ""
        self.origin: dict[str, str] = {}
        self.time_line = TimeLine()
        self.report: dict[str, DeliveryCount] = {}
        self.start_ns: int | None = None
        self.end_ns = 0
        self._segment = ""

    def raw_messages(
        self, topics: Container[Topic[Any]] | None = None, since_ns: int = 0
    ) -> Iterator[RecordedMessage]:
        """Yield messages as they came off the wire.

        Args:
            topics: of these only; None: of all, also unknown ones.
            since_ns: without the chunks before that with this arrival, on the recording's clock
                [ns].

        Raises:
            LoggerError: a file cannot be opened, is not an MCAP log, or is damaged before its end.
        """
        self.truncated = False
        self.time_line = TimeLine()
        self.start_ns, self.end_ns = None, 0
        read = False
        for path in existing_segments(self.path):
            self.origin, self._segment = {}, ""
            with open_mcap(path) as file:
                if file.size >= len(MAGIC) and not file.has_start:
                    raise LoggerError(f"{path} is not an MCAP log: expected MCAP's magic bytes")
                channels: dict[int, _Channel] = {}
                skipped: set[int] = set()
                start: int | None = 0
                if since_ns > 0:
                    read = True
                    index = read_index(path)
                    start = self._chunk_at(index, since_ns)
                    channels = {number: _described(one) for number, one in index.channels.items()}
                    skipped |= {n for n, one in channels.items() if not _is_wanted(one, topics)}
                if start is None:
                    continue
                for record in self._records(file, skipped, start):
                    read = True
                    if isinstance(record, McapMessage):
                        channel = channels.get(record.channel_id)
                        if channel is None:
                            raise DamagedLogError(f"channel {record.channel_id} is not described")
                        log_time = record.log_time
                        yield RecordedMessage(
                            *channel,
                            record.data,
                            log_time,
                            self._place(path, log_time),
                            record.publish_time,
                            record.sequence,
                        )
                    elif isinstance(record, Channel):
                        channels[record.id] = channel = _described(record)
                        if not _is_wanted(channel, topics):
                            skipped.add(record.id)
                    elif isinstance(record, Metadata):
                        self._note(record)
        if not read:
            raise LoggerError(
                f"{self.path} is not an MCAP log: expected MCAP records, got a file of "
                f"{self.path.stat().st_size} bytes without any"
            )

    def messages(self) -> Iterator[tuple[Topic[Any], Message]]:
        """Yield every message of a known topic, decoded; count those refused in ``refused``.

        Raises:
            LoggerError: a file cannot be opened, is not an MCAP log, or is damaged before its end.
        """
        self.refused.clear()
        decoders = Decoders()
        for raw in self.raw_messages():
            if raw.topic is None:
                continue
            try:
                message = decoders.decode(raw.key, raw.payload, raw.topic.schema, raw.tag or None)
            except SchemaError as error:
                self.refused[raw.topic.name] += 1
                self.last_refusal = str(error)
                continue
            yield raw.topic, message

    def _chunk_at(self, index: LogIndex, since_ns: int) -> int | None:
        """Return the offset of a segment's first chunk that ends after ``since_ns``, if any."""
        self.origin = next(iter(index.metadata_named(START_METADATA)), {})
        for place in index.places:
            self._place(index.path, place.start_ns)
            if self._place(index.path, place.end_ns) >= since_ns:
                return place.offset
        return None

    def _records(self, file: McapFile, skipped: Container[int], start: int) -> Iterator[McapRecord]:
        """Yield the records of one segment up to its end, or to where it is cut off."""
        last: Span | None = None
        for last in file.spans(start):
            if last.opcode == UNREADABLE and last.end == file.size:
                break
            if last.opcode == Opcode.CHUNK:
                # Messages that are skipped count for the time line all the same.
                first, end = file.chunk_times(last)
                if end:
                    self._place(file.path, first)
                    self._place(file.path, end)
            yield from file.records(last, skipped)
        if last is None or last.opcode != Opcode.FOOTER:
            self.truncated = True

    def _place(self, segment: Path, log_time: int) -> int:
        """Return an arrival on the recording's clock [ns]."""
        if self._segment != segment.name:
            self._segment = segment.name
            self.time_line.begin_segment(segment.name, self.origin)
        time_ns = self.time_line.place(log_time)
        if self.start_ns is None:
            self.start_ns = time_ns
        self.end_ns = max(self.end_ns, time_ns)
        return time_ns

    def _note(self, record: Metadata) -> None:
        if record.name == START_METADATA:
            self.origin = record.metadata
        elif record.name == DELIVERY_METADATA:
            self.report = DeliveryStats.from_metadata(record.metadata).report()


def _described(channel: Channel) -> _Channel:
    """Return the key, the topic and the schema tag of a channel's messages."""
    about = channel.metadata
    return channel.topic, _TOPICS.get(about.get("topic", "")), about.get("schema_tag", "")


def _is_wanted(channel: _Channel, topics: Container[Topic[Any]] | None) -> bool:
    return topics is None or channel[1] in topics
