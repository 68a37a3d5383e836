"""The exported file."""

import contextlib
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import TracebackType

from mcap.writer import CompressionType, Writer

from services.logger.export.clock import Times
from services.logger.export.errors import ExportError
from services.logger.export.samples import Sample, SampleSchema

METADATA = "trill"
"""Name of the file's metadata record: what it was made from."""


class ExportFile:
    """Takes its final name when all went well; a failed or interrupted export leaves nothing.

    Attributes:
        counts: messages written, by topic.

    Raises:
        ExportError: the file exists already (unless forced) or cannot be written.
    """

    def __init__(self, path: Path, *, force: bool) -> None:
        """Name the file; it is opened on entering."""
        self.path = path
        self.counts: Counter[str] = Counter()
        self._channels: dict[str, int] = {}
        self._schemas: dict[SampleSchema, int] = {}
        self._unfinished = path.with_name(f".{path.name}.unfinished")
        if path.exists() and not force:
            raise ExportError(f"{path} exists already; give another -o, or --force to replace it")

    def __enter__(self) -> "ExportFile":
        """Open the file."""
        with self._told():
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._stream = self._unfinished.open("wb")
        self._writer = Writer(self._stream, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library="trill")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close the file and give it its name, or after an error remove it."""
        try:
            with self._told(), self._stream:
                if kind is None:
                    self._writer.finish()
            if kind is None:
                with self._told():
                    self._unfinished.replace(self.path)
        finally:
            self._unfinished.unlink(missing_ok=True)

    def write(self, sample: Sample, times: Times, sequence: int) -> None:
        """Append one message."""
        with self._told():
            self._writer.add_message(
                channel_id=self._channel(sample),
                log_time=times.logged,
                publish_time=times.sent,
                sequence=sequence,
                data=sample.data,
            )
        self.counts[sample.topic] += 1

    def note(self, facts: Mapping[str, str]) -> None:
        """Say in the file where it comes from."""
        with self._told():
            self._writer.add_metadata(METADATA, dict(facts))

    def _channel(self, sample: Sample) -> int:
        known = self._channels.get(sample.topic)
        if known is None:
            schema = self._schemas.get(sample.schema)
            if schema is None:
                schema = self._writer.register_schema(
                    sample.schema.name, sample.schema.encoding, sample.schema.data
                )
                self._schemas[sample.schema] = schema
            known = self._writer.register_channel(
                sample.topic, sample.schema.message_encoding, schema
            )
            self._channels[sample.topic] = known
        return known

    @contextlib.contextmanager
    def _told(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise ExportError(
                f"cannot write {self.path}: {error.strerror or error}; give a writable -o with "
                "enough space"
            ) from error
