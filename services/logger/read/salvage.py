"""Reads what is left of a damaged MCAP file, record by record.

Whole records are taken as they are, chunks only if their checksum is right. Where the records
stop making sense, the next chunk with a right checksum is looked for. Of a chunk that the file's
end cuts off, the part that is there is decompressed as far as it goes.
"""

import mmap
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import get_chunk_data_stream

from services.logger.errors import LoggerError
from services.logger.read.index import BROKEN, HEAD, MAGIC

_CHUNK = re.compile(
    rb"\x06.{5}\x00\x00\x00.{8}.{8}.{8}.{4}(?:\x04\x00\x00\x00zstd|\x03\x00\x00\x00lz4|\x00{4})",
    re.DOTALL,
)
"""How a chunk record begins: kind, length, times, size, checksum, compression."""
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_SLICE = 4096


@dataclass
class Losses:
    """What could not be read.

    ``skipped`` counts the bytes that made no sense, ``damaged_chunks`` those with a wrong
    checksum, ``partial_messages`` the messages saved from a chunk that was cut off.
    """

    skipped: int = 0
    damaged_chunks: int = 0
    partial_messages: int = 0


class McapRecovery:
    """Iterates over the records left in ``data``, the bytes of a file (or a map of it)."""

    def __init__(self, data: Any) -> None:
        """Prepare; ``losses`` and ``compression`` are filled by the iterations."""
        self._data = data
        self.losses = Losses()
        self.compression: str | None = None
        """Of the first chunk read."""
        self.offset = 0
        """How far it has got [bytes]."""

    def definitions(self) -> Iterator[Schema | Channel]:
        """Schemas and channels outside chunks, by which every chunk can be understood."""
        for opcode, offset, end in self._places():
            if opcode not in (Opcode.SCHEMA, Opcode.CHANNEL):
                continue
            record = self._plain(opcode, offset, end)
            if isinstance(record, Schema | Channel):
                yield record

    def records(self) -> Iterator[McapRecord]:
        """Headers, schemas, channels, messages, metadata and attachments, in order."""
        self.losses = Losses()
        for opcode, offset, end in self._places(self.losses):
            self.offset = offset
            if opcode == Opcode.CHUNK:
                yield from self._chunk(offset, end)
            else:
                record = self._plain(opcode, offset, end)
                if record is not None:
                    yield record
        self.offset = len(self._data)

    def _places(self, losses: Losses | None = None) -> Iterator[tuple[int, int, int]]:
        """Kind, first and last offset of each record's body; the last may be cut off."""
        data, size = self._data, len(self._data)
        offset = len(MAGIC) if data[: len(MAGIC)] == MAGIC else self._next_chunk(0)
        if losses is not None and offset > len(MAGIC):
            losses.skipped += offset
        while offset + HEAD.size <= size:
            opcode, length = HEAD.unpack(data[offset : offset + HEAD.size])
            body = offset + HEAD.size
            end = body + length
            if Opcode.HEADER <= opcode <= Opcode.DATA_END and end <= size and self._fits(end):
                yield opcode, body, end
                if opcode == Opcode.FOOTER:
                    return
                offset = end
                continue
            found = self._next_chunk(offset + 1)
            if found == size and opcode == Opcode.CHUNK and end > size:
                yield opcode, body, size
                return
            if losses is not None:
                losses.skipped += found - offset
            offset = found
        if losses is not None:
            losses.skipped += max(0, size - offset)

    def _fits(self, offset: int) -> bool:
        """Whether a record may begin at ``offset``."""
        data = self._data
        if offset == len(data):
            return True
        if data[offset : offset + len(MAGIC)] == MAGIC:
            return True
        return bool(Opcode.HEADER <= data[offset] <= Opcode.DATA_END)

    def _next_chunk(self, offset: int) -> int:
        """Where the next sound chunk begins; the file's end if nowhere."""
        data, size = self._data, len(self._data)
        for match in _CHUNK.finditer(data, offset):
            at = match.start()
            _, length = HEAD.unpack(data[at : at + HEAD.size])
            body, end = at + HEAD.size, at + HEAD.size + length
            if end <= size and _checked(data[body:end]) is not None:
                return at
        return size

    def _plain(self, opcode: int, offset: int, end: int) -> McapRecord | None:
        """Read a record that is no chunk; None if it is of no interest or damaged."""
        kinds: dict[int, Any] = {
            Opcode.HEADER: Header,
            Opcode.SCHEMA: Schema,
            Opcode.CHANNEL: Channel,
            Opcode.METADATA: Metadata,
            Opcode.ATTACHMENT: Attachment,
        }
        kind = kinds.get(opcode)
        if kind is None:
            return None
        try:
            record: McapRecord = kind.read(ReadDataStream(BytesIO(self._data[offset:end])))
        except BROKEN:
            self.losses.skipped += end - offset
            return None
        return record

    def _chunk(self, offset: int, end: int) -> Iterator[McapRecord]:
        body = self._data[offset:end]
        whole = _checked(body)
        if whole is not None:
            chunk, inside = whole
            if self.compression is None:
                self.compression = chunk.compression
            yield from _inside(inside)
            return
        _, length = HEAD.unpack(self._data[offset - HEAD.size : offset])
        if offset + length <= len(self._data):
            self.losses.damaged_chunks += 1
            return
        for record in _inside(_decompressed_start(body)):
            self.losses.partial_messages += isinstance(record, Message)
            yield record


def records_of(path: Path) -> Iterator[McapRecord]:
    """The records left in the file ``path``.

    Raises:
        LoggerError: it cannot be opened.
    """
    try:
        with (
            path.open("rb") as stream,
            mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data,
        ):
            yield from McapRecovery(data).records()
    except OSError as error:
        raise LoggerError(f"cannot read the log {path}: {error.strerror}") from error


def _checked(body: bytes) -> tuple[Chunk, bytes] | None:
    """Read a chunk and what is in it; None unless its checksum is right."""
    try:
        chunk = Chunk.read(ReadDataStream(BytesIO(body)))
        stream, size = get_chunk_data_stream(chunk, validate_crc=True)
        data: bytes = stream.read(size)
    except BROKEN:
        return None
    return (chunk, data) if len(data) == chunk.uncompressed_size else None


def _decompressed_start(body: bytes) -> bytes:
    """What can be had of the contents of a chunk whose end is missing."""
    try:
        compression_length = struct.unpack_from("<I", body, 28)[0]
        compression = body[32 : 32 + compression_length]
        packed = body[32 + compression_length + 8 :]
    except struct.error:
        return b""
    if not compression:
        return packed
    decompressor: Any = (
        zstandard.ZstdDecompressor().decompressobj()
        if compression == b"zstd"
        else lz4.frame.LZ4FrameDecompressor()
    )
    out = []
    try:
        for start in range(0, len(packed), _SLICE):
            out.append(decompressor.decompress(packed[start : start + _SLICE]))
    except BROKEN:
        pass
    return b"".join(out)


def _inside(data: bytes) -> Iterator[McapRecord]:
    """The complete records at the beginning of a chunk's contents."""
    offset = 0
    while offset + HEAD.size <= len(data):
        opcode, length = HEAD.unpack_from(data, offset)
        offset += HEAD.size
        end = offset + length
        if end > len(data):
            return
        try:
            if opcode == Opcode.MESSAGE:
                channel, sequence, log_time, publish_time = _MESSAGE_HEAD.unpack_from(data, offset)
                yield Message(
                    channel_id=channel,
                    log_time=log_time,
                    data=data[offset + _MESSAGE_HEAD.size : end],
                    publish_time=publish_time,
                    sequence=sequence,
                )
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                kind: Any = Schema if opcode == Opcode.SCHEMA else Channel
                yield kind.read(ReadDataStream(BytesIO(data[offset:end])))
        except BROKEN:
            return
        offset = end
