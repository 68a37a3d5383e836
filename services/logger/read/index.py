"""The index of a log: what it holds and where, found without reading all of it.

A whole file has an index at its end. For a file without its end, or with messages that the index
does not place (those outside chunks), the index is collected by walking from record to record. The
chunks' bodies are skipped, because the writer puts small records behind each chunk that count its
messages by channel.
"""

import struct
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, MetadataIndex, Schema, Statistics
from mcap.records import Message as McapMessage

from services.logger.errors import DamagedLogError, LoggerError
from services.logger.read.chunks import DECODE_ERRORS, RECORD_HEAD, parse_record
from services.logger.read.mcap_file import McapFile, Span, open_mcap

_CHUNK_TIMES = struct.Struct("<QQ")
_CHUNK_INDEX = struct.Struct("<QQQQI")
"""How a chunk's index begins: first and last arrival, offset, length, size of the next table."""
_INDEX_OFFSET = struct.Struct("<HQ")
"""A row of that table: channel, and where its message index is."""
_LENGTH = struct.Struct("<Q")
_IN_SUMMARY = {Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS, Opcode.METADATA_INDEX}
_INDEX_HEAD = struct.Struct("<HI")
_INDEX_ENTRY_SIZE = 16
_INDEX_OVERHEAD = RECORD_HEAD.size + _INDEX_HEAD.size
"""Bytes of a message index without its entries."""
_MESSAGE_HEAD = struct.Struct("<HIQ")
"""How the body of a message begins: channel, sequence, log time."""


@dataclass(frozen=True, slots=True)
class MessagePlace:
    """A chunk, or a run of messages outside chunks.

    Attributes:
        offset: where it begins in the file.
        end: where it ends.
        start_ns: arrival of its first message, monotonic clock [ns].
        end_ns: arrival of its last message [ns].
        channels: those it has messages of.
    """

    offset: int
    end: int
    start_ns: int
    end_ns: int
    channels: frozenset[int]


@dataclass
class LogIndex:
    """What a log file holds; ``whole`` is False for a file without an index at its end."""

    path: Path
    size: int
    whole: bool = False
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    places: list[MessagePlace] = field(default_factory=list)
    metadata: list[Metadata] = field(default_factory=list)
    unplaced: int = 0
    """Messages that the index at the file's end counts but does not place."""

    @property
    def start_ns(self) -> int:
        """Arrival of the first message; 0 if there is none."""
        return min((place.start_ns for place in self.places), default=0)

    @property
    def end_ns(self) -> int:
        """Arrival of the last message; 0 if there is none."""
        return max((place.end_ns for place in self.places), default=0)

    def metadata_named(self, name: str) -> list[dict[str, str]]:
        """Return the metadata records called ``name``, in order."""
        return [record.metadata for record in self.metadata if record.name == name]

    def places_of(self, wanted: Callable[[Channel], bool]) -> list[MessagePlace]:
        """Return the places that have messages of the ``wanted`` channels, in order."""
        ids = self._ids(wanted)
        return [place for place in self.places if not ids.isdisjoint(place.channels)]

    def messages(
        self, wanted: Callable[[Channel], bool], places: Iterable[MessagePlace] | None = None
    ) -> Iterator[tuple[Channel, McapMessage]]:
        """Yield the messages of the ``wanted`` channels; read only places that have any.

        Args:
            wanted: tells which channels.
            places: to read; None: all.

        Raises:
            LoggerError: the file cannot be read, or a chunk is damaged.
        """
        ids = self._ids(wanted)
        with open_mcap(self.path) as file:
            for place in self.places if places is None else places:
                if ids.isdisjoint(place.channels):
                    continue
                file.release(place.offset)
                for span in _spans_of(file, place):
                    for record in file.records(span):
                        if isinstance(record, McapMessage) and record.channel_id in ids:
                            yield self.channels[record.channel_id], record

    def _ids(self, wanted: Callable[[Channel], bool]) -> set[int]:
        return {number for number, channel in self.channels.items() if wanted(channel)}


def read_index(path: Path) -> LogIndex:
    """Index the file ``path``.

    Raises:
        LoggerError: the file cannot be opened or is not an MCAP log.
    """
    with open_mcap(path) as file:
        if not file.has_start:
            raise LoggerError(f"{path} is not an MCAP log: expected MCAP's magic bytes first")
        index = _from_summary(file) if file.has_end else None
        if index is None:
            return _from_walk(file)
        if index.unplaced:
            walked = _from_walk(file)
            return replace(walked, whole=True, counts=index.counts, unplaced=index.unplaced)
        return index


def _spans_of(file: McapFile, place: MessagePlace) -> Iterator[Span]:
    start = place.offset
    while start < place.end:
        span = file.span_at(start)
        yield span
        start = span.end


def _from_summary(file: McapFile) -> LogIndex | None:
    """Use the index at the end of the file; return None if it is unusable."""
    index = LogIndex(file.path, file.size, whole=True)
    statistics: Statistics | None = None
    metadata: list[int] = []
    chunks = _ChunkIndexes()
    try:
        for span in file.summary_spans():
            if span.opcode == Opcode.CHUNK_INDEX:
                chunks.add(file.bytes_of(span.body, span.end))
            elif span.opcode in _IN_SUMMARY:
                record = parse_record(file.bytes_of(span.start, span.end))
                if isinstance(record, Schema):
                    index.schemas[record.id] = record
                elif isinstance(record, Channel):
                    index.channels[record.id] = record
                elif isinstance(record, Statistics):
                    statistics = record
                elif isinstance(record, MetadataIndex):
                    metadata.append(record.offset)
        for offset in sorted(metadata):
            records = file.records(file.span_at(offset))
            index.metadata += [one for one in records if isinstance(one, Metadata)]
    except (*DECODE_ERRORS, DamagedLogError):
        return None
    if statistics is None:
        return None
    index.counts.update(statistics.channel_message_counts)
    index.unplaced = index.counts.total() - chunks.entries
    index.places = sorted(chunks.places, key=lambda one: one.offset)
    return index


class _ChunkIndexes:
    """Takes in the chunk indexes of a file, of which a log of hours has a hundred thousand.

    Attributes:
        places: the chunks.
        entries: number of messages in them.
    """

    def __init__(self) -> None:
        self.places: list[MessagePlace] = []
        self.entries = 0
        self._sets: dict[tuple[int, ...], frozenset[int]] = {}
        """Most chunks have messages of the same channels."""

    def add(self, body: bytes) -> None:
        """Add the chunk index in ``body``; raise one of DECODE_ERRORS if it is damaged."""
        start_ns, end_ns, offset, length, size = _CHUNK_INDEX.unpack_from(body)
        end = _CHUNK_INDEX.size + size
        numbers = tuple(one for one, _ in _INDEX_OFFSET.iter_unpack(body[_CHUNK_INDEX.size : end]))
        (indexes_length,) = _LENGTH.unpack_from(body, end)
        self.entries += (indexes_length - _INDEX_OVERHEAD * len(numbers)) // _INDEX_ENTRY_SIZE
        channels = self._sets.setdefault(numbers, frozenset(numbers))
        self.places.append(MessagePlace(offset, offset + length, start_ns, end_ns, channels))


def _from_walk(file: McapFile) -> LogIndex:
    """Collect the index from the records that can be read."""
    index = LogIndex(file.path, file.size)
    chunk: Span | None = None
    counts: Counter[int] = Counter()
    for span in file.spans():
        if span.opcode == Opcode.MESSAGE_INDEX and span.end - span.body >= _INDEX_HEAD.size:
            head = file.bytes_of(span.body, span.body + _INDEX_HEAD.size)
            channel, size = _INDEX_HEAD.unpack(head)
            counts[channel] += size // _INDEX_ENTRY_SIZE
            continue
        if chunk is not None:
            _add_chunk(index, file, chunk, counts)
            counts = Counter()
        chunk = span if span.opcode == Opcode.CHUNK else None
        if span.opcode == Opcode.MESSAGE:
            _add_message(index, file, span)
        elif chunk is None:
            _note_definitions(index, file, span)
    if chunk is not None:
        # Perhaps not all of the last chunk's message indexes are there: count the messages.
        _add_chunk(index, file, chunk, Counter())
    unknown = index.counts.keys() - index.channels.keys()
    for place in index.places:
        if not place.channels.isdisjoint(unknown):
            _note_definitions(index, file, file.span_at(place.offset))
            unknown -= index.channels.keys()
    return index


def _add_chunk(index: LogIndex, file: McapFile, chunk: Span, counts: Counter[int]) -> None:
    """Add a chunk that has ``counts`` messages by channel; read it if there are no counts."""
    times = file.bytes_of(chunk.body, min(chunk.body + _CHUNK_TIMES.size, chunk.end))
    if counts and len(times) == _CHUNK_TIMES.size:
        first, last = _CHUNK_TIMES.unpack(times)
    else:
        messages = _note_definitions(index, file, chunk)
        counts = Counter(one.channel_id for one in messages)
        first = min((one.log_time for one in messages), default=0)
        last = max((one.log_time for one in messages), default=0)
    if counts:
        index.counts.update(counts)
        place = MessagePlace(chunk.start, chunk.end, first, last, frozenset(counts))
        index.places.append(place)


def _add_message(index: LogIndex, file: McapFile, span: Span) -> None:
    """Add a message outside chunks, to the run of such messages if it goes on there."""
    if span.end - span.body < _MESSAGE_HEAD.size:
        return
    head = file.bytes_of(span.body, span.body + _MESSAGE_HEAD.size)
    channel, _, log_time = _MESSAGE_HEAD.unpack(head)
    index.counts[channel] += 1
    last = index.places[-1] if index.places else None
    if last is None or last.end != span.start:
        last = MessagePlace(span.start, span.end, log_time, log_time, frozenset({channel}))
        index.places.append(last)
        return
    # Most often the channel is known already; a set of its own for each message would be slow.
    channels = last.channels if channel in last.channels else last.channels | {channel}
    start_ns, end_ns = min(last.start_ns, log_time), max(last.end_ns, log_time)
    index.places[-1] = MessagePlace(last.offset, span.end, start_ns, end_ns, channels)


def _note_definitions(index: LogIndex, file: McapFile, span: Span) -> list[McapMessage]:
    """Note the schemas, channels and metadata at ``span``; return the messages there."""
    messages = []
    try:
        for record in file.records(span):
            if isinstance(record, Schema):
                index.schemas.setdefault(record.id, record)
            elif isinstance(record, Channel):
                index.channels.setdefault(record.id, record)
            elif isinstance(record, Metadata):
                index.metadata.append(record)
            elif isinstance(record, McapMessage):
                messages.append(record)
    except DamagedLogError:
        pass
    return messages
