"""Checks whether a log file is whole."""

import contextlib
import struct
import zlib
from collections import Counter
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Footer, Message, MessageIndex
from mcap.stream_reader import StreamReader

from services.logger.errors import DamagedLogError
from services.logger.read.chunks import DECODE_ERRORS
from services.logger.read.index import read_index
from services.logger.read.mcap_file import MAGIC, McapFile, open_mcap

OnProgress = Callable[[int, int], None]
"""Called with how much of a file is done and how large it is [bytes]."""

_PROGRESS_STEP = 2**20
"""Between two calls of :data:`OnProgress` [bytes]."""
_MESSAGE_IN_CHUNK = struct.Struct("<BQHIQ")
"""How a message record begins: opcode, length, channel, sequence, log time."""


def fault_of(path: Path, on_progress: OnProgress | None = None) -> str:
    """Read the whole file and return what is wrong with it; an empty text if nothing is.

    Checks what readers rely on: that records follow one another from the beginning to the end,
    each chunk's checksum, each message's place in the index, and that the index at the end agrees
    with the records.

    Raises:
        LoggerError: the file cannot be opened.
    """
    with open_mcap(path) as file:
        if not file.has_start:
            return "it does not begin like an MCAP file"
        if not file.has_end:
            return "its end is missing"
        try:
            footer = _check_records(file, on_progress)
            _check_summary_checksum(file, footer)
        except DamagedLogError as fault:
            return str(fault)
        except DECODE_ERRORS as error:
            return f"it is damaged ({error})"
    return ""


def _check_records(file: McapFile, on_progress: OnProgress | None) -> Footer:
    """Check the records against the index; return the footer."""
    index = read_index(file.path)
    if not index.whole:
        raise DamagedLogError("its index is unreadable")
    counts: Counter[int] = Counter()
    chunks: list[int] = []
    metadata = reported = 0
    inside = b""
    footer: Footer | None = None
    for span in file.spans():
        if on_progress is not None and span.start >= reported + _PROGRESS_STEP:
            reported = span.start
            on_progress(reported, file.size)
        if span.opcode == Opcode.CHUNK:
            inside = file.chunk_data(span)
            chunks.append(span.start)
        elif span.opcode == Opcode.MESSAGE:
            counts.update(m.channel_id for m in file.records(span) if isinstance(m, Message))
        elif span.opcode == Opcode.MESSAGE_INDEX:
            body = file.bytes_of(span.body, span.end)
            found = MessageIndex.read(ReadDataStream(BytesIO(body)))
            _check_message_index(found, inside)
            counts[found.channel_id] += len(found.records)
        elif span.opcode == Opcode.METADATA:
            metadata += 1
        else:
            footer = next((r for r in file.records(span) if isinstance(r, Footer)), None)
    if footer is None or span.end != file.size - len(MAGIC):
        raise DamagedLogError(f"its records end at byte {span.end} of {file.size}")
    placed = index.unplaced or chunks == [place.offset for place in index.places]
    if +counts != +index.counts or not placed:
        raise DamagedLogError("its index does not fit its messages")
    if metadata != len(index.metadata) or not counts.keys() <= index.channels.keys():
        raise DamagedLogError("its index leaves records out")
    return footer


def stated_messages(path: Path, *, walk: bool) -> int:
    """Return how many messages the file should hold at least, whatever this project reads of it.

    That is what its statistics say. Without these it is what the MCAP library reads before it
    fails, which takes long, or 0 without ``walk``.
    """
    with path.open("rb") as stream:
        with contextlib.suppress(*DECODE_ERRORS):
            summary = SeekingReader(stream).get_summary()
            if summary is not None and summary.statistics is not None:
                return int(summary.statistics.message_count)
        stream.seek(0)
        count = 0
        if not walk:
            return count
        with contextlib.suppress(*DECODE_ERRORS):
            for record in StreamReader(stream, validate_crcs=True).records:
                count += isinstance(record, Message)
    return count


def _check_message_index(index: MessageIndex, inside: bytes) -> None:
    """Check that a chunk's message index points at messages of its channel."""
    for time, place in index.records:
        opcode, _, channel, _, log_time = _MESSAGE_IN_CHUNK.unpack_from(inside, place)
        if (opcode, channel, log_time) != (Opcode.MESSAGE, index.channel_id, time):
            raise DamagedLogError("a message index does not fit its chunk")


def _check_summary_checksum(file: McapFile, footer: Footer) -> None:
    """Check the index's checksum, which covers the footer without the checksum itself as well."""
    covered = file.bytes_of(footer.summary_start, file.size - len(MAGIC) - 4)
    if footer.summary_crc and zlib.crc32(covered) != footer.summary_crc:
        raise DamagedLogError("the checksum of its index is wrong")
