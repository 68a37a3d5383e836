"""Writes samples of the bus to an MCAP file."""

import contextlib
import fcntl
import json
import os
import platform
import time
from collections.abc import Iterator, Mapping
from pathlib import Path

from mcap.data_stream import RecordBuilder
from mcap.records import Channel, Schema
from mcap.writer import Writer

from common.schemas import Header, Message
from common.transport.keys import topic_of
from common.transport.schema_query import Description
from common.transport.tap import RawSample
from common.wire.codec import schema_tag
from services.logger.log_format import (
    COMPRESSION,
    PROFILE,
    START_METADATA,
    write_error,
)
from services.logger.record.config import LoggerConfig


class McapSink:
    """An MCAP file open for writing.

    Each key gets a channel with message encoding ``msgpack``, the JSON Schema of its topic and the
    schema tag of its sender. For a key that is not in the topic table, or is sent with another
    version of the schema, the sender's description of the schema is used if it is known.
    ``log_time`` is the arrival and ``publish_time`` the sender's ``header.sent``, both on the
    monotonic clock; the file's first metadata record ties that clock to the wall clock.

    Schemas and channels are written twice, inside the chunk where they are first used and behind
    it, so that the other chunks can be read even if that one is damaged. The open file is locked
    against repairs.

    Every method raises :class:`LoggerError` when the file cannot be written.
    """

    def __init__(
        self,
        path: Path,
        robot: str,
        config: LoggerConfig,
        about: Mapping[str, str] | None = None,
    ) -> None:
        """Create ``path`` for messages of ``robot``; an existing file is refused, not overwritten.

        ``about`` holds facts about the recording for the file's first metadata record.
        """
        self.path = path
        self._robot = robot
        self._channels: dict[tuple[str, str], int] = {}
        self._bare: set[tuple[str, str]] = set()
        self._schemas: dict[tuple[str, bytes], int] = {}
        self._copies: list[Schema | Channel] = []
        self._described: Mapping[str, Description] = {}
        with _explained(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = path.open("xb")
            with contextlib.suppress(OSError):  # not every file system has locks
                fcntl.flock(self._stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._writer = Writer(
                self._stream,
                chunk_size=config.chunk_size,
                compression=COMPRESSION[config.compression],
            )
            self._writer.start(profile=PROFILE)
            self._writer.add_metadata(START_METADATA, _origin(robot) | dict(about or {}))
            self._stream.flush()

    @property
    def size(self) -> int:
        """Size written so far, without the open chunk [bytes]."""
        return self._stream.tell()

    @property
    def undescribed(self) -> bool:
        """Whether a channel in use has no schema."""
        return not self._bare.isdisjoint(self._channels)

    def describe(self, descriptions: Mapping[str, Description]) -> None:
        """Provide senders' descriptions, for channels that have no schema so far too."""
        self._described = descriptions
        for key, tag in self._bare & self._channels.keys():
            if self._schema_of(key, tag) is not None:
                del self._channels[key, tag]

    def write(self, sample: RawSample, header: Header | None) -> None:
        """Append one message; after the next :meth:`flush` a kill cannot lose it."""
        # Without _explained: this is done for every message.
        try:
            self._writer.add_message(
                channel_id=self._channels.get((sample.key, sample.tag)) or self._channel(sample),
                log_time=sample.arrival_ns,
                publish_time=sample.arrival_ns if header is None else header.sent,
                sequence=0 if header is None else header.seq % 2**32,
                data=sample.payload,
            )
        except OSError as error:
            raise write_error(self.path, error) from error

    def note(self, name: str, values: Mapping[str, str]) -> None:
        """Write a metadata record."""
        with _explained(self.path):
            self._writer.add_metadata(name, dict(values))

    def flush(self) -> None:
        """Close the open chunk and hand everything to the operating system."""
        with _explained(self.path):
            self._writer.flush()
            if self._copies:
                builder = RecordBuilder()
                for record in self._copies:
                    record.write(builder)
                self._stream.write(builder.end())
                self._copies.clear()
                self._stream.flush()

    def close(self, *, sync: bool = True) -> None:
        """Write the index and close the file."""
        self.finish()
        self.release(sync=sync)

    def finish(self) -> None:
        """Write the index; only :meth:`release` may follow."""
        self.flush()
        with _explained(self.path):
            self._writer.finish()
            self._stream.flush()

    def release(self, *, sync: bool = True) -> None:
        """Close the file; with ``sync`` wait until it is on the disk, which can take long."""
        with _explained(self.path), self._stream:
            if sync:
                os.fsync(self._stream.fileno())

    def abandon(self) -> None:
        """Close the file without an end, after a write failed."""
        with contextlib.suppress(OSError):
            self._stream.close()

    def _channel(self, sample: RawSample) -> int:
        """Register the channel of a sample that has none yet."""
        topic = topic_of(self._robot, sample.key)
        metadata = {"robot": self._robot, "schema_tag": sample.tag}
        if topic is not None:
            metadata["topic"] = topic.name
        schema = self._schema(self._schema_of(sample.key, sample.tag))
        number = int(self._writer.register_channel(sample.key, "msgpack", schema, metadata))
        self._copies.append(
            Channel(
                id=number,
                topic=sample.key,
                message_encoding="msgpack",
                schema_id=schema,
                metadata=metadata,
            )
        )
        self._channels[sample.key, sample.tag] = number
        if not schema:
            self._bare.add((sample.key, sample.tag))
        return number

    def _schema_of(self, key: str, tag: str) -> tuple[str, bytes] | None:
        """Return name and JSON Schema of what is sent under ``key`` with ``tag``, if known."""
        topic = topic_of(self._robot, key)
        if topic is not None:
            schema: type[Message] = topic.schema
            if tag in ("", schema_tag(schema)):
                text = json.dumps(schema.model_json_schema(), ensure_ascii=False)
                return f"{schema.__name__}/{schema.VERSION}", text.encode()
        found = self._described.get(key)
        if found is not None and found.tag == tag:
            return found.name, found.jsonschema.encode()
        return None

    def _schema(self, wanted: tuple[str, bytes] | None) -> int:
        if wanted is None:
            return 0
        known = self._schemas.get(wanted)
        if known is None:
            name, data = wanted
            known = self._writer.register_schema(name, "jsonschema", data)
            self._copies.append(Schema(id=known, data=data, encoding="jsonschema", name=name))
            self._schemas[wanted] = known
        return known


def _origin(robot: str) -> dict[str, str]:
    return _boot() | {
        "robot": robot,
        "clock": "CLOCK_MONOTONIC",
        "monotonic_ns": str(time.monotonic_ns()),
        "wall_ns": str(time.time_ns()),
        "host": platform.node(),
        "python": platform.python_version(),
    }


def _boot() -> dict[str, str]:
    """Return what tells the monotonic clock of this boot from others, as far as the system says."""
    found = {}
    with contextlib.suppress(OSError):
        found["boot_id"] = Path("/proc/sys/kernel/random/boot_id").read_text().strip()
    with contextlib.suppress(AttributeError, OSError):
        found["boottime_ns"] = str(time.clock_gettime_ns(time.CLOCK_BOOTTIME))
    return found


@contextlib.contextmanager
def _explained(path: Path) -> Iterator[None]:
    """Convert an operating-system error to a LoggerError that says what to do."""
    try:
        yield
    except OSError as error:
        raise write_error(path, error) from error
