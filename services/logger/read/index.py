"""The index of a log: what is in it and where, without reading all of it.

A whole file has an index at its end. Of a file that ends early it is worked out by walking from
record to record, over the chunks' bodies, since each chunk is followed by small records that say
which channels are in it.
"""

import struct
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Footer, Metadata, Schema
from mcap.records import Message as McapMessage
from mcap.stream_reader import breakup_chunk
from zstandard import ZstdError

from services.logger.errors import LoggerError

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")
"""What each record begins with: kind and length of what follows."""
FOOTER_SIZE = HEAD.size + 8 + 8 + 4 + len(MAGIC)
BROKEN = (McapError, ZstdError, ValueError, RuntimeError, struct.error, OverflowError, EOFError)
"""What reading damaged bytes can raise."""

_CHUNK_HEAD = struct.Struct("<QQQII")


@dataclass(frozen=True)
class ChunkPlace:
    """Where a chunk is and which channels have messages in it."""

    offset: int
    start_ns: int
    end_ns: int
    channels: frozenset[int]


@dataclass
class LogIndex:
    """What a log file holds.

    ``whole`` is False for a file without its end, and then ``valid_size`` says how much of it
    could be followed [bytes].
    """

    path: Path
    size: int
    whole: bool = False
    valid_size: int = 0
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    chunks: list[ChunkPlace] = field(default_factory=list)
    metadata: list[Metadata] = field(default_factory=list)

    @property
    def start_ns(self) -> int:
        """Arrival of the first message; 0 if there is none."""
        return min((chunk.start_ns for chunk in self.chunks), default=0)

    @property
    def end_ns(self) -> int:
        """Arrival of the last message; 0 if there is none."""
        return max((chunk.end_ns for chunk in self.chunks), default=0)

    def named(self, name: str) -> list[dict[str, str]]:
        """The metadata records called ``name``, in order."""
        return [record.metadata for record in self.metadata if record.name == name]

    def messages(self, wanted: Callable[[Channel], bool]) -> Iterator[tuple[Channel, McapMessage]]:
        """Messages of the channels that are ``wanted``; reads only chunks that have any.

        Raises:
            LoggerError: the file cannot be read, or a chunk is damaged.
        """
        ids = {number for number, channel in self.channels.items() if wanted(channel)}
        try:
            with self.path.open("rb") as stream:
                for place in self.chunks:
                    if ids.isdisjoint(place.channels):
                        continue
                    for record in breakup_chunk(_chunk_at(stream, place.offset)):
                        if isinstance(record, McapMessage) and record.channel_id in ids:
                            yield self.channels[record.channel_id], record
        except OSError as error:
            raise LoggerError(f"cannot read the log {self.path}: {error.strerror}") from error
        except BROKEN as error:
            raise LoggerError(
                f"the log {self.path} is damaged: {error}; `trill repair` saves the rest"
            ) from error


def read_index(path: Path) -> LogIndex:
    """Index the file ``path``.

    Raises:
        LoggerError: it cannot be opened or is not an MCAP log.
    """
    try:
        with path.open("rb") as stream:
            size = path.stat().st_size
            if stream.read(len(MAGIC)) != MAGIC:
                raise LoggerError(
                    f"{path} is not an MCAP log: expected MCAP's first bytes, got others"
                )
            return _from_summary(path, stream, size) or _from_walk(path, stream, size)
    except OSError as error:
        raise LoggerError(f"cannot open the log {path}: {error.strerror}") from error


def has_end(stream: IO[bytes], size: int) -> bool:
    """Whether the file ends with a footer and MCAP's last bytes."""
    if size < FOOTER_SIZE + len(MAGIC):
        return False
    stream.seek(size - FOOTER_SIZE)
    tail = stream.read(FOOTER_SIZE)
    return tail.endswith(MAGIC) and tail[0] == Opcode.FOOTER


def read_footer(stream: IO[bytes], size: int) -> Footer:
    """The footer of a file that :func:`has_end`."""
    stream.seek(size - FOOTER_SIZE + HEAD.size)
    return Footer.read(ReadDataStream(stream))


def _from_summary(path: Path, stream: IO[bytes], size: int) -> LogIndex | None:
    """Use the index at the file's end; None if there is no usable one."""
    if not has_end(stream, size):
        return None
    try:
        stream.seek(0)
        summary = make_reader(stream).get_summary()
        if summary is None or summary.statistics is None:
            return None
        index = LogIndex(path, size, whole=True, valid_size=size)
        for place in sorted(summary.metadata_indexes, key=lambda one: one.offset):
            stream.seek(place.offset + HEAD.size)
            index.metadata.append(Metadata.read(ReadDataStream(stream)))
    except BROKEN:
        return None
    index.schemas, index.channels = dict(summary.schemas), dict(summary.channels)
    index.counts.update(summary.statistics.channel_message_counts)
    index.chunks = [
        ChunkPlace(
            one.chunk_start_offset,
            one.message_start_time,
            one.message_end_time,
            frozenset(one.message_index_offsets),
        )
        for one in sorted(summary.chunk_indexes, key=lambda one: one.chunk_start_offset)
    ]
    return index


def _from_walk(path: Path, stream: IO[bytes], size: int) -> LogIndex:
    """Work the index out, as far as the records follow one another."""
    index = LogIndex(path, size, valid_size=len(MAGIC))
    pending: tuple[int, int, int] | None = None
    counts: Counter[int] = Counter()

    def settle(*, cut: bool = False) -> None:
        """Note the chunk whose index has been read; ``cut``: perhaps not all of it."""
        if pending is None:
            return
        if cut or not counts:
            counts.clear()
            counts.update(_inside(index, stream, pending[0]))
        index.counts.update(counts)
        index.chunks.append(ChunkPlace(*pending, frozenset(counts)))
        counts.clear()

    for offset, opcode, length in walk(stream, size):
        try:
            stream.seek(offset + HEAD.size)
            if opcode == Opcode.MESSAGE_INDEX:
                channel, entries = struct.unpack("<HI", stream.read(6))
                counts[channel] += entries // 16
            elif opcode == Opcode.CHUNK:
                settle()
                start, end, _, _, _ = _CHUNK_HEAD.unpack(stream.read(_CHUNK_HEAD.size))
                pending = (offset, start, end)
            else:
                _note(index, opcode, stream)
        except BROKEN:
            break
        index.valid_size = offset + HEAD.size + length
    settle(cut=True)
    unknown = index.counts.keys() - index.channels.keys()
    for place in index.chunks:
        if not place.channels.isdisjoint(unknown):
            _inside(index, stream, place.offset)
            unknown -= index.channels.keys()
    return index


def walk(stream: IO[bytes], size: int) -> Iterator[tuple[int, int, int]]:
    """Offset, kind and length of each complete record from the file's beginning."""
    offset = len(MAGIC)
    while offset + HEAD.size <= size:
        stream.seek(offset)
        opcode, length = HEAD.unpack(stream.read(HEAD.size))
        if not Opcode.HEADER <= opcode <= Opcode.DATA_END or offset + HEAD.size + length > size:
            return
        yield offset, opcode, length
        offset += HEAD.size + length


def _note(index: LogIndex, opcode: int, stream: IO[bytes]) -> None:
    data = ReadDataStream(stream)
    if opcode == Opcode.SCHEMA:
        schema = Schema.read(data)
        index.schemas.setdefault(schema.id, schema)
    elif opcode == Opcode.CHANNEL:
        channel = Channel.read(data)
        index.channels.setdefault(channel.id, channel)
    elif opcode == Opcode.METADATA:
        index.metadata.append(Metadata.read(data))


def _inside(index: LogIndex, stream: IO[bytes], offset: int) -> Counter[int]:
    """Count the messages of a chunk by channel, and note its schemas and channels."""
    counts: Counter[int] = Counter()
    try:
        records = breakup_chunk(_chunk_at(stream, offset))
    except BROKEN:
        return counts
    for record in records:
        if isinstance(record, Schema):
            index.schemas.setdefault(record.id, record)
        elif isinstance(record, Channel):
            index.channels.setdefault(record.id, record)
        elif isinstance(record, McapMessage):
            counts[record.channel_id] += 1
    return counts


def _chunk_at(stream: IO[bytes], offset: int) -> Chunk:
    stream.seek(offset + HEAD.size)
    return Chunk.read(ReadDataStream(stream))
