"""Says whether a log file is whole, and if not, why."""

import struct
import zlib
from collections import Counter
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import IO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Chunk, Footer, MessageIndex
from mcap.stream_reader import get_chunk_data_stream

from services.logger.errors import LoggerError
from services.logger.read.index import (
    BROKEN,
    FOOTER_SIZE,
    HEAD,
    MAGIC,
    has_end,
    read_footer,
    read_index,
    walk,
)

Progress = Callable[[int, int], None]
"""Told how far a long work has got, and how far it goes [bytes]."""


class _FaultError(Exception):
    """Something is wrong with the file; the text says what."""


def fault_of(path: Path, progress: Progress | None = None) -> str:
    """Read all of the file; what is wrong with it, in words, or nothing.

    Checks what every reader relies on: that the records follow one another to the end, each
    chunk's checksum, each message's place in the index, and that the index at the end tells the
    same story.

    Raises:
        LoggerError: it cannot be opened.
    """
    try:
        size = path.stat().st_size
        with path.open("rb") as stream:
            if stream.read(len(MAGIC)) != MAGIC:
                return "it does not begin like an MCAP file"
            if not has_end(stream, size):
                return "its end is missing"
            _check_summary(stream, size)
            _check_records(path, stream, size, progress)
    except _FaultError as fault:
        return str(fault)
    except OSError as error:
        raise LoggerError(f"cannot open the log {path}: {error.strerror}") from error
    except BROKEN as error:
        return f"it is damaged ({error})"
    return ""


def _check_summary(stream: IO[bytes], size: int) -> None:
    footer: Footer = read_footer(stream, size)
    if not footer.summary_start:
        raise _FaultError("it has no index")
    stream.seek(footer.summary_start)
    # The checksum covers the summary and the footer's own first fields.
    covered = stream.read(size - FOOTER_SIZE + HEAD.size + 16 - footer.summary_start)
    if footer.summary_crc and zlib.crc32(covered) != footer.summary_crc:
        raise _FaultError("the checksum of its index is wrong")


def _check_records(path: Path, stream: IO[bytes], size: int, progress: Progress | None) -> None:
    index = read_index(path)
    if not index.whole:
        raise _FaultError("its index is unreadable")
    counts: Counter[int] = Counter()
    chunks: list[int] = []
    metadata = 0
    inside = b""
    ended = 0
    for offset, opcode, length in walk(stream, size):
        stream.seek(offset + HEAD.size)
        ended = offset + HEAD.size + length
        if opcode == Opcode.CHUNK:
            inside = _checked_chunk(stream.read(length), offset)
            chunks.append(offset)
            if progress is not None:
                progress(offset, size)
        elif opcode == Opcode.MESSAGE_INDEX:
            found = MessageIndex.read(ReadDataStream(stream))
            _check_places(found, inside)
            counts[found.channel_id] += len(found.records)
        elif opcode == Opcode.METADATA:
            metadata += 1
        elif opcode == Opcode.FOOTER:
            break
    if ended != size - len(MAGIC):
        raise _FaultError(f"its records end at byte {ended} of {size}")
    if +counts != +index.counts or chunks != [place.offset for place in index.chunks]:
        raise _FaultError("its index does not fit its messages")
    if metadata != len(index.metadata) or not counts.keys() <= index.channels.keys():
        raise _FaultError("its index leaves records out")


def _checked_chunk(body: bytes, offset: int) -> bytes:
    chunk = Chunk.read(ReadDataStream(BytesIO(body)))
    try:
        stream, size = get_chunk_data_stream(chunk, validate_crc=True)
    except BROKEN as error:
        raise _FaultError(f"the chunk at byte {offset} is damaged ({error})") from error
    data: bytes = stream.read(size)
    if len(data) != chunk.uncompressed_size:
        raise _FaultError(f"the chunk at byte {offset} has a wrong size")
    return data


def _check_places(index: MessageIndex, inside: bytes) -> None:
    """Check that a chunk's message index points at messages of its channel."""
    for time, place in index.records:
        opcode, _, channel, _, log_time = struct.unpack_from("<BQHIQ", inside, place)
        if (opcode, channel, log_time) != (Opcode.MESSAGE, index.channel_id, time):
            raise _FaultError("a message index does not fit its chunk")
