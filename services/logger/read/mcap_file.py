"""Reads the records of an MCAP file that may be whole, cut off or damaged.

This is the one reader under everything that reads logs. It maps the file and walks from record to
record without touching the bodies, so that finding something in a large file stays fast. Chunks
are accepted only with a correct checksum. After damaged bytes the walk resumes at the next chunk
with a correct checksum. A chunk that the end of the file cuts off is decompressed as far as it
goes.
"""

import mmap
import os
import re
import struct
from collections.abc import Container, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Chunk, McapRecord
from mcap.stream_reader import get_chunk_data_stream
from mcap.writer import MCAP0_MAGIC

from services.logger.errors import DamagedLogError, LoggerError
from services.logger.read.chunks import (
    DECODE_ERRORS,
    RECORD_HEAD,
    decompress_start,
    parse_record,
    split_records,
)

MAGIC: bytes = MCAP0_MAGIC
"""First and last bytes of an MCAP file."""
UNREADABLE = 0
"""Opcode of a span that belongs to no record; MCAP uses this number for none."""

_WINDOW = 2**24
"""Pages of a large file are given back after a walk has gone on by this [bytes]."""
_FOOTER_SIZE = RECORD_HEAD.size + 20 + len(MAGIC)
_CHUNK_START = re.compile(
    rb"\x06.{5}\x00\x00\x00.{8}.{8}.{8}.{4}(?:\x04\x00\x00\x00zstd|\x03\x00\x00\x00lz4|\x00{4})",
    re.DOTALL,
)
"""How a chunk record begins: opcode, length, times, size, checksum, compression."""
_CHUNK_TIMES = struct.Struct("<QQ")
_OFFSET = struct.Struct("<Q")
_COMPRESSION_OFFSET = 28
"""Of a chunk's compression name in its body."""
_PARSED = {
    Opcode.HEADER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA, Opcode.ATTACHMENT, Opcode.FOOTER,
}  # fmt: skip
"""Kinds of records outside chunks that are of interest; the others serve the index."""


@dataclass(frozen=True, slots=True)
class Span:
    """The place of one record in the file, or of bytes that belong to no record.

    Attributes:
        opcode: kind of the record, or :data:`UNREADABLE`.
        start: offset of the record.
        body: offset of the record's body.
        end: offset behind the record.
        complete: False if the end of the file cuts the record off.
    """

    opcode: int
    start: int
    body: int
    end: int
    complete: bool = True


class McapFile:
    """An MCAP file of ``size`` bytes, opened by :func:`open_mcap`."""

    def __init__(self, path: Path, data: Any) -> None:
        """Read the file ``path``, whose bytes are ``data`` (a memory map, or bytes)."""
        self.path = path
        self.size = len(data)
        self._data = data
        self._released = 0

    @property
    def has_start(self) -> bool:
        """Whether the file begins as an MCAP file."""
        return bool(self._data[: len(MAGIC)] == MAGIC)

    @property
    def has_end(self) -> bool:
        """Whether the file ends with a footer and MCAP's magic bytes."""
        tail = self._data[-_FOOTER_SIZE:]
        return bool(tail.endswith(MAGIC) and tail[0] == Opcode.FOOTER)

    def bytes_of(self, start: int, end: int) -> bytes:
        """Return the bytes from offset ``start`` to ``end``."""
        return bytes(self._data[start:end])

    def span_at(self, start: int) -> Span:
        """Return the place of the record that begins at offset ``start``.

        Raises:
            DamagedLogError: the file ends before that.
        """
        body = start + RECORD_HEAD.size
        if body > self.size:
            raise DamagedLogError(f"byte {start} is beyond its end")
        opcode, length = RECORD_HEAD.unpack_from(self._data, start)
        end = body + length
        return Span(opcode, start, body, min(end, self.size), complete=end <= self.size)

    def spans(self, start: int = 0) -> Iterator[Span]:
        """Yield the records up to the footer in order, with the unreadable bytes between them.

        With ``start`` they begin with the record at that offset.
        """
        start = max(start, len(MAGIC))
        if not self.has_start:
            start = self._next_chunk(0)
            if start:
                yield Span(UNREADABLE, 0, 0, start)
        while start + RECORD_HEAD.size <= self.size:
            span = self.span_at(start)
            self.release(start)
            if self._is_record(span):
                yield span
                if span.opcode == Opcode.FOOTER:
                    return
                start = span.end
                continue
            resumed = self._next_chunk(start + 1)
            if resumed == self.size and span.opcode == Opcode.CHUNK and not span.complete:
                yield span
                return
            yield Span(UNREADABLE, start, start, resumed)
            start = resumed
        if start < self.size:
            yield Span(UNREADABLE, start, start, self.size)

    def summary_spans(self) -> Iterator[Span]:
        """Yield the records of the index at the end of a file that has its end.

        Raises:
            DamagedLogError: there is no index, or its records do not reach to the footer.
        """
        footer = self.size - _FOOTER_SIZE
        (start,) = _OFFSET.unpack_from(self._data, footer + RECORD_HEAD.size)
        if not len(MAGIC) <= start <= footer:
            raise DamagedLogError("it has no index")
        while start < footer:
            span = self.span_at(start)
            yield span
            start = span.end

    def records(self, span: Span, skipped: Container[int] = ()) -> Iterator[McapRecord]:
        """Yield the record at ``span``, or the records in the chunk at ``span``.

        Records of kinds that only serve the index are passed over, and messages of the channels
        ``skipped``.

        Raises:
            DamagedLogError: the record is damaged, or the span is unreadable.
        """
        if span.opcode == UNREADABLE:
            raise DamagedLogError(f"the {span.end - span.start} bytes at {span.start} are damaged")
        if span.opcode == Opcode.CHUNK:
            yield from split_records(
                self.chunk_data(span) if span.complete else self._start_of_chunk_data(span),
                skipped,
            )
        elif span.opcode == Opcode.MESSAGE:
            # Outside chunks, as other writers may have it.
            yield from split_records(self.bytes_of(span.start, span.end), skipped)
        elif span.opcode in _PARSED:
            try:
                record = parse_record(self.bytes_of(span.start, span.end))
            except DECODE_ERRORS as error:
                kind = Opcode(span.opcode).name.lower()
                raise DamagedLogError(
                    f"the {kind} at byte {span.start} is damaged ({error})"
                ) from error
            yield record

    def chunk_data(self, span: Span) -> bytes:
        """Return the decompressed contents of the complete chunk at ``span``.

        Raises:
            DamagedLogError: the contents do not have the size and checksum that the chunk states.
        """
        try:
            chunk = Chunk.read(ReadDataStream(BytesIO(self._data[span.body : span.end])))
            stream, size = get_chunk_data_stream(chunk, validate_crc=True)
            data: bytes = stream.read(size) if size else b""
        except DECODE_ERRORS as error:
            raise DamagedLogError(f"the chunk at byte {span.start} is damaged ({error})") from error
        if len(data) != chunk.uncompressed_size:
            raise DamagedLogError(
                f"the chunk at byte {span.start} is damaged ({len(data)} bytes of "
                f"{chunk.uncompressed_size})"
            )
        return data

    def chunk_times(self, chunk: Span) -> tuple[int, int]:
        """Return the earliest and the latest arrival in a chunk [ns]; zeros if it is cut off."""
        if chunk.end - chunk.body < _CHUNK_TIMES.size:
            return 0, 0
        first, last = _CHUNK_TIMES.unpack_from(self._data, chunk.body)
        return first, last

    def compression(self, chunk: Span) -> str:
        """Return the name of a chunk's compression; empty for none, or if it is not there."""
        start = chunk.body + _COMPRESSION_OFFSET
        name = self.bytes_of(start, min(start + 8, chunk.end))
        length = int.from_bytes(name[:4], "little")
        return name[4 : 4 + length].decode(errors="replace")

    def release(self, end: int) -> None:
        """Give back the memory of whole windows before ``end``, since the last time or the start.

        Otherwise all of a large file would seem to be in this process's memory in the end.
        """
        start = self._released if end >= self._released else 0
        end -= end % _WINDOW
        if end > start and isinstance(self._data, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
            self._data.madvise(mmap.MADV_DONTNEED, start, end - start)
        self._released = end

    def _start_of_chunk_data(self, span: Span) -> bytes:
        """Return as much as can be decompressed of a chunk whose end is missing."""
        compression = self.compression(span)
        # Behind the compression's name stands the size of the compressed data.
        start = span.body + _COMPRESSION_OFFSET + 4 + len(compression) + 8
        return decompress_start(compression, self.bytes_of(start, span.end))

    def _is_record(self, span: Span) -> bool:
        """Return whether there is a complete record at ``span``, by what stands behind it too."""
        if not (span.complete and _is_opcode(span.opcode)):
            return False
        following = self._data[span.end : span.end + len(MAGIC)]
        if not following or following == MAGIC or _is_opcode(following[0]):
            return True
        return self._is_intact_chunk(span)

    def _is_intact_chunk(self, span: Span) -> bool:
        if span.opcode != Opcode.CHUNK or not span.complete:
            return False
        try:
            self.chunk_data(span)
        except DamagedLogError:
            return False
        return True

    def _next_chunk(self, offset: int) -> int:
        """Return the offset of the next undamaged chunk; the file's size if there is none."""
        for match in _CHUNK_START.finditer(self._data, offset):
            if self._is_intact_chunk(self.span_at(match.start())):
                return match.start()
        return self.size


@contextmanager
def open_mcap(path: Path) -> Iterator[McapFile]:
    """Open the file ``path`` for reading.

    Raises:
        LoggerError: the file cannot be opened, or the block under ``with`` met damage.
    """
    try:
        with path.open("rb") as stream:
            # An empty file cannot be mapped.
            empty = not os.fstat(stream.fileno()).st_size
            data: Any = b"" if empty else mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
    except FileNotFoundError as error:
        raise LoggerError(
            f"cannot open the log {path}: there is no such file; expected a log (log.mcap) or the "
            "directory of a run"
        ) from error
    except OSError as error:
        raise LoggerError(f"cannot open the log {path}: {error.strerror}") from error
    try:
        yield McapFile(path, data)
    except DamagedLogError as error:
        raise LoggerError(
            f"the log {path} is damaged: {error}; `trill repair` saves the rest"
        ) from error
    finally:
        if not empty:
            data.close()


def _is_opcode(number: int) -> bool:
    """Return whether ``number`` is the opcode of a record outside chunks."""
    return bool(Opcode.HEADER <= number <= Opcode.DATA_END)
