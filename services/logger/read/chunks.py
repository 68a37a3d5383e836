"""Decodes the contents of MCAP chunks, also of a chunk whose end is missing."""

import struct
from collections.abc import Iterator
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


def split_records(data: bytes) -> Iterator[McapRecord]:
    """Yield the complete schemas, channels and messages at the beginning of a chunk's contents."""
    start = 0
    while start + RECORD_HEAD.size <= len(data):
        opcode, length = RECORD_HEAD.unpack_from(data, start)
        body = start + RECORD_HEAD.size
        end = body + length
        if end > len(data):
            return
        try:
            if opcode == Opcode.MESSAGE:
                channel, sequence, log_time, publish_time = _MESSAGE_HEAD.unpack_from(data, body)
                yield Message(
                    channel_id=channel,
                    log_time=log_time,
                    data=data[body + _MESSAGE_HEAD.size : end],
                    publish_time=publish_time,
                    sequence=sequence,
                )
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
