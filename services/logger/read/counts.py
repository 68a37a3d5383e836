"""What became of a key's messages, in numbers."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields

from services.logger.errors import LoggerError


@dataclass
class KeyCount:
    """One key's account.

    ``sent`` is ``recorded + lost + dropped``. The file has ``recorded + repeated`` messages.
    """

    recorded: int = 0
    """Different messages in the file."""
    dropped: int = 0
    """Arrived, but were dropped by the logger because its queue was full."""
    lost: int = 0
    """Missing by sequence number and never arrived: lost on the way."""
    repeated: int = 0
    """Recorded again with a sequence number that was recorded before."""
    late: int = 0
    """Recorded after a message with a higher sequence number."""
    headerless: int = 0
    """Of those recorded: without a usable header, so that none missing can be told."""
    earlier: int = 0
    """Sent before the first one heard of its stream; not part of ``sent``."""
    bytes: int = 0
    """Of the recorded messages' payloads."""
    first_ns: int = 0
    last_ns: int = 0
    """Arrival of the first and the last recorded, monotonic clock."""

    @property
    def missing(self) -> int:
        """Sent, but not in the file."""
        return self.lost + self.dropped

    @property
    def sent(self) -> int:
        """What the publishers sent from the first message heard of to the last."""
        return self.recorded + self.missing


_COLUMNS = ("sent", "recorded", "lost", "dropped", "repeated", "late", "headerless")


def format_report(report: Mapping[str, KeyCount]) -> str:
    """A table of the report for a person, with a line of totals."""
    width = max([len(key) for key in report] + [5])
    lines = [f"{'topic':<{width}} " + " ".join(f"{name:>10}" for name in _COLUMNS)]
    rows = [*report.items(), ("total", total(report))]
    lines += [
        f"{key:<{width}} " + " ".join(f"{getattr(count, name):>10}" for name in _COLUMNS)
        for key, count in rows
    ]
    lines.append(
        "sent = recorded + lost (on the way, by sequence number) + dropped (here, queue full)"
    )
    earlier = total(report).earlier
    if earlier:
        lines.append(f"before that, {earlier} were sent that this recorder could not hear yet")
    return "\n".join(lines)


def total(report: Mapping[str, KeyCount]) -> KeyCount:
    """The sum of all keys; its times are those of the earliest and the latest message."""
    result = KeyCount()
    for count in report.values():
        for name in ("recorded", "dropped", "lost", "repeated", "late", "headerless", "earlier"):
            setattr(result, name, getattr(result, name) + getattr(count, name))
        result.bytes += count.bytes
    seen = [count for count in report.values() if count.recorded]
    result.first_ns = min((count.first_ns for count in seen), default=0)
    result.last_ns = max((count.last_ns for count in seen), default=0)
    return result


def to_metadata(report: Mapping[str, KeyCount]) -> dict[str, str]:
    """The report as MCAP metadata: key to JSON."""
    return {key: json.dumps(asdict(count) | {"sent": count.sent}) for key, count in report.items()}


def from_metadata(metadata: Mapping[str, str]) -> dict[str, KeyCount]:
    """Inverse of :func:`to_metadata`; what only other versions count is passed over.

    Raises:
        LoggerError: the metadata is not such a report.
    """
    known = {one.name for one in fields(KeyCount)}
    try:
        return {
            key: KeyCount(**{n: int(v) for n, v in json.loads(text).items() if n in known})
            for key, text in metadata.items()
        }
    except (ValueError, TypeError, AttributeError) as error:
        raise LoggerError(
            f"the log's report is unreadable: expected counts by topic, got {dict(metadata)}"
        ) from error
