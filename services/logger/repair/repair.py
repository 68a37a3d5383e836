"""Repairs a log that was cut off or damaged.

Everything that can be read is written to a new file with index, schemas and metadata; delivery
statistics are rebuilt from the messages. The new file is written beside the old one,
synchronised to the disk and read back before it takes the old one's name.
"""

import shutil
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, McapRecord, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from common.files import whole_file
from services.logger.errors import LoggerError
from services.logger.log_format import (
    COMPRESSION,
    DELIVERY_METADATA,
    PROFILE,
    REPAIR_METADATA,
    write_error,
)
from services.logger.read.delivery import DeliveryCount
from services.logger.read.index import read_index
from services.logger.read.locks import keep_original, locked
from services.logger.read.mcap_file import McapFile, open_mcap
from services.logger.read.rebuild import DeliveryRebuilder
from services.logger.read.recovery import Losses, recover
from services.logger.repair.verify import OnProgress, fault_of, stated_messages

_PROGRESS_STEP = 2**20
"""Between two calls of ``on_progress`` [bytes]."""


@dataclass(frozen=True)
class RepairResult:
    """What the repair of one file found and did.

    Attributes:
        path: the file as it was given.
        fault: what was wrong with it; empty if it was whole, and then it is unchanged.
        output: the whole file.
        kept: new name of the broken file; None if there is none, or it was not replaced.
        messages: number of messages in the output.
        stated: number of messages that the broken file should hold, where that is more.
        unknown: number of messages left out because their channel is not described.
        losses: what could not be read.
        report: delivery counts by key.
    """

    path: Path
    fault: str
    output: Path
    kept: Path | None = None
    messages: int = 0
    stated: int = 0
    unknown: int = 0
    losses: Losses = field(default_factory=Losses)
    report: dict[str, DeliveryCount] = field(default_factory=dict)


def repair(
    path: Path,
    out: Path | None = None,
    *,
    discard_original: bool = False,
    on_progress: OnProgress | None = None,
) -> RepairResult:
    """Make the file ``path`` whole; a whole one is left as it is.

    Args:
        path: one file; the segments of a recording are repaired one by one.
        out: write the result here and leave ``path`` as it is.
        discard_original: do not keep the broken file as ``<name>.broken``, unless fewer messages
            come out of it than it should hold.
        on_progress: called during the check and again during the rewriting.

    Raises:
        LoggerError: the file is being recorded, nothing in it can be read, or the result cannot
            be written; ``path`` is then as it was.
    """
    if out is not None and out.exists():
        raise LoggerError(f"{out} exists already; give another --out")
    with locked(path):
        fault = fault_of(path, on_progress)
        target = path if out is None else out
        try:
            if not fault:
                if out is not None:
                    with whole_file(target) as copy:
                        shutil.copyfile(path, copy)
                return RepairResult(path, "", target)
            with whole_file(target) as rewritten:
                rebuilt, losses = _rewrite(path, rewritten, fault, on_progress)
                _read_back(rewritten, rebuilt.messages)
                stated = stated_messages(path, walk=out is None and discard_original)
                lacking = stated > rebuilt.messages
                keep = out is None and (lacking or not discard_original)
                kept = keep_original(path) if keep else None
        except OSError as error:
            raise write_error(target, error) from error
    return RepairResult(
        path,
        fault,
        target,
        kept,
        rebuilt.messages,
        stated if lacking else 0,
        rebuilt.unknown,
        losses,
        rebuilt.stats.report(),
    )


def _rewrite(
    path: Path, output: Path, fault: str, on_progress: OnProgress | None
) -> tuple[DeliveryRebuilder, Losses]:
    """Write everything that can be read of ``path`` to the new file ``output``."""
    losses = Losses()
    with open_mcap(path) as file, output.open("wb") as stream:
        if next(recover(file), None) is None:
            raise LoggerError(f"{path}: nothing in it can be read as an MCAP log; {fault}")
        copy = _Copy(stream, file)
        reported = 0
        for span, record in recover(file, losses):
            copy.add(record)
            if on_progress is not None and span.start >= reported + _PROGRESS_STEP:
                reported = span.start
                on_progress(reported, file.size)
        copy.finish(fault, losses, file.size)
    return copy.rebuilt, losses


class _Copy:
    """The new file, to which the old one's records are added."""

    def __init__(self, stream: IO[bytes], original: McapFile) -> None:
        self.rebuilt = DeliveryRebuilder()
        self._schemas: dict[int, Schema] = {}
        self._schema_ids: dict[int, int] = {}
        self._channel_ids: dict[int, int] = {}
        self._writer = Writer(stream, compression=_compression_of(original))
        header = next((r for _, r in recover(original, opcodes={Opcode.HEADER})), None)
        library = {"library": header.library} if isinstance(header, Header) else {}
        profile = header.profile if isinstance(header, Header) else PROFILE
        self._writer.start(profile=profile, **library)
        # The definitions that stand outside chunks explain the chunks behind damaged ones.
        for _, record in recover(original, opcodes={Opcode.SCHEMA, Opcode.CHANNEL}):
            self.add(record)

    def add(self, record: McapRecord) -> None:
        """Copy one record."""
        if isinstance(record, Schema):
            self._schemas.setdefault(record.id, record)
        elif isinstance(record, Message):
            self._add_message(record)
        elif isinstance(record, Metadata):
            if record.name != DELIVERY_METADATA:
                self._writer.add_metadata(record.name, record.metadata)
        elif isinstance(record, Attachment):
            self._writer.add_attachment(
                record.create_time, record.log_time, record.name, record.media_type, record.data
            )
        self.rebuilt.add(record)

    def finish(self, fault: str, losses: Losses, size: int) -> None:
        """Write the rebuilt statistics, a record of the repair, and the index."""
        facts = {
            "fault": fault,
            "wall_ns": time.time_ns(),
            "size": size,
            "skipped": losses.unreadable_bytes,
            "damaged_chunks": losses.damaged_chunks,
            "partial_messages": losses.partial_messages,
            "unknown": self.rebuilt.unknown,
        }
        self._writer.add_metadata(REPAIR_METADATA, {name: str(v) for name, v in facts.items()})
        self._writer.add_metadata(DELIVERY_METADATA, self.rebuilt.stats.to_metadata())
        self._writer.finish()

    def _add_message(self, message: Message) -> None:
        channel = self.rebuilt.channels.get(message.channel_id)
        if channel is not None:
            self._writer.add_message(
                channel_id=self._channel_id(channel),
                log_time=message.log_time,
                data=message.data,
                publish_time=message.publish_time,
                sequence=message.sequence,
            )

    def _channel_id(self, channel: Channel) -> int:
        """Return the channel's number in the new file."""
        if channel.id not in self._channel_ids:
            self._channel_ids[channel.id] = self._writer.register_channel(
                channel.topic,
                channel.message_encoding,
                self._schema_id(channel.schema_id),
                channel.metadata,
            )
        return self._channel_ids[channel.id]

    def _schema_id(self, original: int) -> int:
        """Return the schema's number in the new file; 0 if the schema is not known."""
        schema = self._schemas.get(original)
        if schema is None:
            return 0
        if original not in self._schema_ids:
            self._schema_ids[original] = self._writer.register_schema(
                schema.name, schema.encoding, schema.data
            )
        return self._schema_ids[original]


def _compression_of(file: McapFile) -> CompressionType:
    """Return how the file's first chunk is compressed."""
    for span in file.spans():
        if span.opcode == Opcode.CHUNK:
            return COMPRESSION.get(file.compression(span) or "none", CompressionType.ZSTD)
    return CompressionType.ZSTD


def _read_back(path: Path, messages: int) -> None:
    """Make sure that the result is whole before it takes the broken file's place.

    Raises:
        LoggerError: it is not.
    """
    fault = fault_of(path)
    if not fault:
        found = read_index(path).counts.total()
        fault = "" if found == messages else f"it has {found} messages of {messages}"
    if fault:
        raise LoggerError(f"the repaired file does not read back: {fault}; nothing was changed")
