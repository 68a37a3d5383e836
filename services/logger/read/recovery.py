"""Recovers whatever can be read of a damaged MCAP file, and counts what cannot."""

from collections.abc import Container, Iterator
from dataclasses import dataclass

from mcap.opcode import Opcode
from mcap.records import McapRecord, Message

from services.logger.errors import DamagedLogError
from services.logger.read.mcap_file import McapFile, Span


@dataclass
class Losses:
    """What could not be read of a file, and what was saved of its last chunk.

    Attributes:
        unreadable_bytes: bytes that belong to no record, or to a damaged one outside a chunk.
        damaged_chunks: chunks with a wrong checksum.
        partial_messages: messages saved from a chunk that the end of the file cuts off.
    """

    unreadable_bytes: int = 0
    damaged_chunks: int = 0
    partial_messages: int = 0


def recover(
    file: McapFile, losses: Losses | None = None, opcodes: Container[int] | None = None
) -> Iterator[tuple[Span, McapRecord]]:
    """Yield every readable record, with its span or its chunk's; count the rest in ``losses``.

    ``opcodes`` are the kinds of records outside chunks to read; None: all, and the chunks.
    """
    losses = losses or Losses()
    for span in file.spans():
        if opcodes is not None and span.opcode not in opcodes:
            continue
        try:
            for record in file.records(span):
                if not span.complete and isinstance(record, Message):
                    losses.partial_messages += 1
                yield span, record
        except DamagedLogError:
            if span.opcode == Opcode.CHUNK:
                losses.damaged_chunks += 1
            else:
                losses.unreadable_bytes += span.end - span.start
