"""Makes a log whole that was cut off or damaged.

Everything that can be read is written anew, with index, schemas and metadata; the account, the
counts and the episodes are worked out again. The new file is written beside the old one, put on
the disk, read back, and only then takes its name.
"""

import mmap
import os
import shutil
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Header, Message, Metadata, Schema
from mcap.writer import Writer

from services.logger.errors import LoggerError
from services.logger.log_format import (
    ACCOUNT_METADATA,
    COMPRESSION,
    EPISODE_METADATA,
    PROFILE,
    REPAIR_METADATA,
    REPORT_METADATA,
)
from services.logger.read.locks import keep, locked, put, tidy
from services.logger.read.restored import RebuiltMetadata
from services.logger.read.salvage import Losses, McapRecovery
from services.logger.read.tally import KeyCount, to_metadata
from services.logger.repair.verify import Progress, fault_of


@dataclass(frozen=True)
class Repair:
    """What the repair of one file found and did.

    Attributes:
        path: the file as it was given.
        fault: what was wrong with it; empty if it was whole and nothing was changed.
        result: the whole file.
        kept: where the broken one is now; None if it is not kept, or was not touched.
        messages: in the result.
        unknown: messages whose channel could not be told, and which are therefore left out.
        losses: what could not be read.
        report: counts by key.
    """

    path: Path
    fault: str
    result: Path
    kept: Path | None = None
    messages: int = 0
    unknown: int = 0
    losses: Losses = field(default_factory=Losses)
    report: dict[str, KeyCount] = field(default_factory=dict)


def repair(
    path: Path,
    out: Path | None = None,
    *,
    discard_original: bool = False,
    progress: Progress | None = None,
) -> Repair:
    """Make the file ``path`` whole; a whole one is left as it is.

    Args:
        path: one file; the parts of a recording are repaired one by one.
        out: write the result here and leave ``path`` alone.
        discard_original: do not keep the broken file as ``<name>.broken``.
        progress: told how far reading has got, first to check, then to rewrite.

    Raises:
        LoggerError: the file is being recorded, holds nothing to save, or the result cannot be
            written; ``path`` is then as it was.
    """
    if out is not None and out.exists():
        raise LoggerError(f"{out} exists already; give another --out")
    with locked(path):
        fault = fault_of(path, progress)
        target = path if out is None else out
        beside = target.with_name(f".{target.name}.repairing")
        if not fault:
            if out is not None:
                with tidy(beside, target):
                    shutil.copyfile(path, beside)
                    put(beside, target)
            return Repair(path, "", target)
        with tidy(beside, target):
            done, restored, losses, unknown = _rewrite(path, beside, fault, progress)
            _read_back(beside, restored.messages)
            kept = None if out is not None or discard_original else keep(path)
            put(beside, target)
    return Repair(path, fault, target, kept, restored.messages, unknown, losses, done)


def _rewrite(
    path: Path, beside: Path, fault: str, progress: Progress | None
) -> tuple[dict[str, KeyCount], RebuiltMetadata, Losses, int]:
    """Write to ``beside`` all that can be read of ``path``."""
    size = path.stat().st_size
    if not size:
        raise LoggerError(f"{path} is empty: there is nothing to save in it")
    with (
        path.open("rb") as stream,
        mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as data,
        beside.open("xb") as written,
    ):
        salvage = McapRecovery(data)
        copy = _Copy(written, salvage)
        for number, record in enumerate(salvage.records()):
            copy.take(record)
            if progress is not None and number % 512 == 0:
                progress(salvage.offset, size)
        if not copy.begun:
            raise LoggerError(f"{path}: nothing in it can be read as an MCAP log; {fault}")
        report = copy.end(fault, size)
        written.flush()
        os.fsync(written.fileno())
    return report, copy.restored, salvage.losses, copy.unknown


class _Copy:
    """The new file, fed with the old one's records."""

    def __init__(self, stream: IO[bytes], salvage: McapRecovery) -> None:
        self.restored = RebuiltMetadata()
        self.unknown = 0
        self.begun = False
        self._stream = stream
        self._salvage = salvage
        self._writer: Any = None
        self._profile, self._library = PROFILE, ""
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._ids: dict[int, int] = {}
        self._schema_ids: dict[int, int] = {0: 0}
        for record in salvage.definitions():
            self._define(record)

    def take(self, record: object) -> None:
        """Copy one record."""
        if isinstance(record, Header):
            self.begun = True
            self._profile, self._library = record.profile, record.library
        elif isinstance(record, Schema | Channel):
            self.begun = True
            self._define(record)
        elif isinstance(record, Message):
            self._message(record)
        elif isinstance(record, Metadata):
            self.begun = True
            self.restored.metadata(record.name, record.metadata)
            if record.name not in (REPORT_METADATA, ACCOUNT_METADATA):
                self._open_writer()
                self._writer.add_metadata(record.name, record.metadata)
        elif isinstance(record, Attachment):
            self._open_writer()
            self._writer.add_attachment(
                record.create_time,
                record.log_time,
                record.name,
                record.media_type,
                record.data,
            )

    def end(self, fault: str, size: int) -> dict[str, KeyCount]:
        """Write what the file says about itself, and its index."""
        self._open_writer()
        for episode in self.restored.unrecorded_episodes():
            self._writer.add_metadata(EPISODE_METADATA, episode.to_metadata())
        losses = self._salvage.losses
        self._writer.add_metadata(
            REPAIR_METADATA,
            {
                "fault": fault,
                "wall_ns": str(time.time_ns()),
                "size": str(size),
                "skipped": str(losses.skipped),
                "damaged_chunks": str(losses.damaged_chunks),
                "partial_messages": str(losses.partial_messages),
                "unknown": str(self.unknown),
            },
        )
        report = self.restored.tally.report()
        self._writer.add_metadata(ACCOUNT_METADATA, self.restored.tally.state())
        self._writer.add_metadata(REPORT_METADATA, to_metadata(report))
        self._writer.finish()
        return report

    def _open_writer(self) -> None:
        if self._writer is None:
            # Of a file that ends in its first chunk, nobody knows; ours are zstd.
            name = {None: "zstd", "": "none"}.get(
                self._salvage.compression, self._salvage.compression
            )
            self._writer = Writer(self._stream, compression=COMPRESSION[str(name)])
            options = {"library": self._library} if self._library else {}
            self._writer.start(profile=self._profile, **options)

    def _define(self, record: Schema | Channel) -> None:
        known: dict[int, Any] = self._schemas if isinstance(record, Schema) else self._channels
        known.setdefault(record.id, record)

    def _message(self, message: Message) -> None:
        channel = self._channels.get(message.channel_id)
        if channel is None:
            self.unknown += 1
            return
        self._open_writer()
        self._writer.add_message(
            channel_id=self._channel_id(channel),
            log_time=message.log_time,
            data=message.data,
            publish_time=message.publish_time,
            sequence=message.sequence,
        )
        self.restored.message(channel, message)

    def _channel_id(self, channel: Channel) -> int:
        known = self._ids.get(channel.id)
        if known is None:
            schema_id = self._schema_ids.get(channel.schema_id)
            if schema_id is None:
                schema = self._schemas.get(channel.schema_id)
                schema_id = (
                    0
                    if schema is None
                    else self._writer.register_schema(schema.name, schema.encoding, schema.data)
                )
                self._schema_ids[channel.schema_id] = schema_id
            known = self._writer.register_channel(
                channel.topic, channel.message_encoding, schema_id, channel.metadata
            )
            self._ids[channel.id] = known
        return known


def _read_back(path: Path, messages: int) -> None:
    """Make sure that the result is whole before it takes the broken file's place."""
    fault = fault_of(path)
    if not fault:
        try:
            with path.open("rb") as stream:
                summary = make_reader(stream).get_summary()
        except McapError as error:
            fault = str(error)
        else:
            found = summary.statistics.message_count if summary and summary.statistics else 0
            fault = "" if found == messages else f"it has {found} messages of {messages}"
    if fault:
        raise LoggerError(f"the repaired file does not read back: {fault}; nothing was changed")
