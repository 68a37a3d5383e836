"""Writes samples of the bus to an MCAP file."""

import contextlib
import errno
import json
import os
import platform
import shutil
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType, Writer

from common.bus.keys import topic_of
from common.bus.tap import RawSample
from common.schemas import Header
from services.logger.config import LoggerConfig
from services.logger.errors import LoggerError

PROFILE = "trill"
START_METADATA = "recording"
REPORT_METADATA = "report"
"""Names of the file's metadata records: how the recording was made, and its counts (at the end)."""

_COMPRESSION = {
    "zstd": CompressionType.ZSTD,
    "lz4": CompressionType.LZ4,
    "none": CompressionType.NONE,
}


class McapSink:
    """An MCAP file open for writing.

    Each key gets a channel with message encoding ``msgpack``, the JSON Schema of its topic and the
    schema tag it was sent with; a key that is not in the topic table is recorded without a
    schema. ``log_time`` is the arrival and ``publish_time`` the sender's ``header.sent``, both on
    the monotonic clock; the file's first metadata record ties that clock to the wall clock.

    Every method raises :class:`LoggerError` when the file cannot be written.
    """

    def __init__(self, path: Path, robot: str, config: LoggerConfig) -> None:
        """Create ``path``; an existing file is refused, not overwritten."""
        self.path = path
        self._robot = robot
        self._channels: dict[tuple[str, str], int] = {}
        self._schemas: dict[str, int] = {}
        with _told(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = path.open("xb")
            self._writer = Writer(
                self._stream,
                chunk_size=config.chunk_size,
                compression=_COMPRESSION[config.compression],
            )
            self._writer.start(profile=PROFILE)
            self._writer.add_metadata(START_METADATA, _origin(robot))
            self._stream.flush()

    def write(self, sample: RawSample, header: Header | None) -> None:
        """Append one message; it is safe from a kill only after the next :meth:`flush`."""
        with _told(self.path):
            self._writer.add_message(
                channel_id=self._channel(sample),
                log_time=sample.arrival_ns,
                publish_time=sample.arrival_ns if header is None else header.sent,
                sequence=0 if header is None else header.seq % 2**32,
                data=sample.payload,
            )

    def flush(self) -> None:
        """Close the open chunk and hand everything to the operating system."""
        with _told(self.path):
            self._writer.flush()

    def close(self, report: Mapping[str, str]) -> None:
        """Write the report and the index, and close the file."""
        with _told(self.path), self._stream:
            self._writer.flush()
            self._writer.add_metadata(REPORT_METADATA, dict(report))
            self._writer.finish()
            self._stream.flush()
            os.fsync(self._stream.fileno())

    def abandon(self) -> None:
        """Close the file as it is, after a write failed."""
        with contextlib.suppress(OSError):
            self._stream.close()

    def _channel(self, sample: RawSample) -> int:
        wanted = (sample.key, sample.tag)
        known = self._channels.get(wanted)
        if known is None:
            topic = topic_of(self._robot, sample.key)
            metadata = {"robot": self._robot, "schema_tag": sample.tag}
            schema = 0
            if topic is not None:
                metadata["topic"] = topic.name
                schema = self._schema(topic.schema)
            known = self._writer.register_channel(sample.key, "msgpack", schema, metadata)
            self._channels[wanted] = known
        return known

    def _schema(self, schema: Any) -> int:
        known = self._schemas.get(schema.__name__)
        if known is None:
            text = json.dumps(schema.model_json_schema(), ensure_ascii=False)
            known = self._writer.register_schema(
                f"{schema.__name__}/{schema.VERSION}", "jsonschema", text.encode()
            )
            self._schemas[schema.__name__] = known
        return known


def _origin(robot: str) -> dict[str, str]:
    return {
        "robot": robot,
        "clock": "CLOCK_MONOTONIC",
        "monotonic_ns": str(time.monotonic_ns()),
        "wall_ns": str(time.time_ns()),
        "host": platform.node(),
        "python": platform.python_version(),
    }


@contextlib.contextmanager
def _told(path: Path) -> Iterator[None]:
    """Turn operating-system errors into one that says what to do."""
    try:
        yield
    except OSError as error:
        if isinstance(error, FileExistsError) and error.filename == str(path):
            raise LoggerError(f"{path} exists already; give a new --out directory") from error
        cure = "give a writable --out directory"
        if error.errno in {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}:
            cure = f"free some space ({_room(path)}); what was flushed before stays readable"
        raise LoggerError(
            f"cannot write the log {path}: {error.strerror or error}; {cure}"
        ) from error


def _room(path: Path) -> str:
    free = shutil.disk_usage(path.parent).free
    return f"{free / 2**20:.0f} MiB free in {path.parent}"
