"""Reads a log back, message by message, also one whose writer was killed."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from io import BufferedIOBase
from pathlib import Path
from typing import IO, Any

from mcap.exceptions import EndOfFile, InvalidMagic, McapError
from mcap.records import Channel, McapRecord, Metadata
from mcap.records import Message as McapMessage
from mcap.stream_reader import StreamReader
from zstandard import ZstdError

from common.errors import SchemaError
from common.schemas import Message
from common.topics import ALL_TOPICS, Topic
from common.wire.codec import decode
from services.logger.errors import LoggerError
from services.logger.log_format import REPORT_METADATA, START_METADATA
from services.logger.read.parts import existing_parts
from services.logger.read.tally import KeyCount, from_metadata

_TOPICS: dict[str, Topic[Any]] = {topic.name: topic for topic in ALL_TOPICS}


@dataclass(frozen=True, slots=True)
class Entry:
    """One recorded message, still in its wire bytes.

    ``topic`` is None for a key that was not in the topic table when it was recorded, or is no
    longer. Times are of the monotonic clock [ns].
    """

    key: str
    topic: Topic[Any] | None
    tag: str
    payload: bytes
    log_time: int
    publish_time: int
    sequence: int


class LogReader:
    """Iterates over a log in the order of arrival, front to back, without needing its index.

    A recording that was interrupted and went on in further parts is read as one.

    The findings below are complete once an iteration has come to its end.

    Attributes:
        path: the file, or the first of its parts.
        truncated: whether a part ends before its footer, as it does when the logger was killed.
        refused: messages that did not fit today's schema, by topic name.
        last_refusal: the newest refusal in words.
        origin: how the recording was made; ties the monotonic clock to the wall clock.
        report: the logger's own counts by key; empty if it was killed.
    """

    def __init__(self, path: Path) -> None:
        """Name the file; it is opened by each iteration."""
        self.path = path
        self.truncated = False
        self.refused: Counter[str] = Counter()
        self.last_refusal = ""
        self.origin: dict[str, str] = {}
        self.report: dict[str, KeyCount] = {}

    def entries(self) -> Iterator[Entry]:
        """Every recorded message as it came off the wire.

        Raises:
            LoggerError: the file cannot be opened or is not an MCAP log.
        """
        channels: dict[int, Channel] = {}
        for record in self._records():
            if isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, McapMessage):
                yield _entry(channels[record.channel_id], record)
            elif isinstance(record, Metadata) and record.name == START_METADATA:
                self.origin = record.metadata
            elif isinstance(record, Metadata) and record.name == REPORT_METADATA:
                self.report = from_metadata(record.metadata)

    def messages(self) -> Iterator[tuple[Topic[Any], Message]]:
        """Every message of a known topic, decoded; those refused are counted and passed over.

        Raises:
            LoggerError: the file cannot be opened or is not an MCAP log.
        """
        self.refused.clear()
        for entry in self.entries():
            if entry.topic is None:
                continue
            try:
                message = decode(entry.payload, entry.topic.schema, entry.tag or None)
            except SchemaError as error:
                self.refused[entry.topic.name] += 1
                self.last_refusal = str(error)
                continue
            yield entry.topic, message

    def _records(self) -> Iterator[McapRecord]:
        self.truncated = False
        empty = True
        for path in existing_parts(self.path):
            for record in self._records_of(path):
                empty = False
                yield record
        if empty:
            raise LoggerError(
                f"{self.path} is not an MCAP log: expected MCAP records, got a file of "
                f"{self.path.stat().st_size} bytes without any"
            )

    def _records_of(self, path: Path) -> Iterator[McapRecord]:
        try:
            stream = path.open("rb")
        except OSError as error:
            raise LoggerError(f"cannot open the log {path}: {error.strerror}") from error
        with stream:
            try:
                yield from StreamReader(_WholeReads(stream)).records
            except EndOfFile:
                self.truncated = True
            except InvalidMagic as error:
                raise LoggerError(
                    f"{path} is not an MCAP log: expected MCAP's first bytes, got others"
                ) from error
            except (McapError, ZstdError, ValueError, RuntimeError) as error:
                raise LoggerError(f"the log {path} is damaged: {error}") from error


class _WholeReads(BufferedIOBase):
    """A stream that never returns less than asked for: a record cut off is no record."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream = stream

    def read(self, size: int | None = -1, /) -> bytes:
        """Read ``size`` bytes.

        Raises:
            EndOfFile: fewer are left.
        """
        data = self._stream.read(-1 if size is None else size)
        if size is not None and len(data) < size:
            raise EndOfFile
        return data


def _entry(channel: Channel, record: McapMessage) -> Entry:
    return Entry(
        key=channel.topic,
        topic=_TOPICS.get(channel.metadata.get("topic", "")),
        tag=channel.metadata.get("schema_tag", ""),
        payload=record.data,
        log_time=record.log_time,
        publish_time=record.publish_time,
        sequence=record.sequence,
    )
