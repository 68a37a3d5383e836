"""Writes the exported MCAP file."""

import contextlib
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO

from mcap.writer import CompressionType, Writer

from common.files import whole_file
from services.logger.errors import ExportError
from services.logger.export.samples import Sample, SampleSchema
from services.logger.read.sender_clocks import Times

METADATA = "trill"
"""Name of the file's metadata record: what it was made from."""


class ExportFile:
    """An exported file open for writing, and its messages by topic; see :func:`export_file`."""

    def __init__(self, stream: IO[bytes], profile: str) -> None:
        """Begin a file on ``stream``; ``profile`` is MCAP's name for what its messages are."""
        self.counts: Counter[str] = Counter()
        self._channels: dict[str, int] = {}
        self._schemas: dict[SampleSchema, int] = {}
        self._writer = Writer(stream, compression=CompressionType.ZSTD)
        self._writer.start(profile=profile, library="trill")

    def write(self, sample: Sample, times: Times, sequence: int) -> None:
        """Append one message."""
        self._writer.add_message(
            channel_id=self._channels.get(sample.topic) or self._channel(sample),
            log_time=times.logged,
            publish_time=times.sent,
            sequence=sequence,
            data=sample.data,
        )
        self.counts[sample.topic] += 1

    def finish(self, facts: Mapping[str, str]) -> None:
        """Write the index, with ``facts`` about what the file was made from."""
        self._writer.add_metadata(METADATA, dict(facts))
        self._writer.finish()

    def _channel(self, sample: Sample) -> int:
        """Register the channel of a topic that has none yet."""
        schema = sample.schema
        if schema not in self._schemas:
            self._schemas[schema] = self._writer.register_schema(
                schema.name, schema.encoding, schema.data
            )
        number: int = self._writer.register_channel(
            sample.topic, schema.message_encoding, self._schemas[schema]
        )
        self._channels[sample.topic] = number
        return number


@contextlib.contextmanager
def export_file(path: Path, *, force: bool, profile: str = "") -> Iterator[ExportFile]:
    """Write the file ``path``, which appears when the block has ended well, and only then.

    Raises:
        ExportError: the file exists already (and not ``force``), or cannot be written.
    """
    if path.exists() and not force:
        raise ExportError(f"{path} exists already; give another -o, or --force to replace it")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as unfinished, unfinished.open("wb") as stream:
            yield ExportFile(stream, profile)
    except OSError as error:
        raise ExportError(
            f"cannot write {path}: {error.strerror or error}; give a writable -o with enough space"
        ) from error
