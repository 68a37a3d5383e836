"""Decodes the contents of MCAP chunks, also of a chunk whose end is missing."""

import struct
from collections.abc import Container, Iterator
from io import BytesIO
from typing import Any

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import McapRecord, Message
from mcap.stream_reader import StreamReader

RECORD_HEAD = struct.Struct("<BQ")
"""How each record begins: opcode and length of the body."""
DECODE_ERRORS = (
    McapError, zstandard.ZstdError, ValueError, RuntimeError, struct.error, OverflowError, EOFError,
)  # fmt: skip
"""Exceptions that decoding damaged bytes can raise."""

_MESSAGE_HEAD = struct.Struct("<HIQQ")
_DECOMPRESSION_STEP = 4096


def parse_record(data: bytes) -> McapRecord:
    """Return the record that ``data``, with its head, holds; raise one of DECODE_ERRORS."""
    record: McapRecord = next(StreamReader(BytesIO(data), skip_magic=True).records)
    return record


def split_records(data: bytes, skipped: Container[int] = ()) -> Iterator[McapRecord]:
    """Yield the complete schemas, channels and messages at the beginning of a chunk's contents.

    Messages of the ``skipped`` channels are passed over.
    """
    # This is done for every message of a log, so nothing is looked up twice.
    head, message_head = RECORD_HEAD.unpack_from, _MESSAGE_HEAD.unpack_from
    size, record, fields, kind = len(data), RECORD_HEAD.size, _MESSAGE_HEAD.size, Opcode.MESSAGE
    start = 0
    while start + record <= size:
        opcode, length = head(data, start)
        body = start + record
        end = body + length
        if end > size:
            return
        try:
            if opcode == kind:
                channel, sequence, log_time, publish_time = message_head(data, body)
                if channel not in skipped:
                    content = data[body + fields : end]
                    yield Message(channel, log_time, content, publish_time, sequence)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                yield parse_record(data[start:end])
        except DECODE_ERRORS:
            return
        start = end


def decompress_start(compression: str, data: bytes) -> bytes:
    """Decompress ``data``, whose end is missing, as far as it goes."""
    if not compression:
        return data
    decompressor: Any = (
        zstandard.ZstdDecompressor().decompressobj()
        if compression == "zstd"
        else lz4.frame.LZ4FrameDecompressor()
    )
    parts = []
    try:
        for start in range(0, len(data), _DECOMPRESSION_STEP):
            parts.append(decompressor.decompress(data[start : start + _DECOMPRESSION_STEP]))
    except DECODE_ERRORS:
        pass
    return b"".join(parts)
