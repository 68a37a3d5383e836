"""Counts per key: recorded, missing by sequence number, unreadable."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass

from common.bus.sequence import SequenceTracker
from common.schemas import Header
from services.logger.errors import LoggerError


@dataclass
class KeyCount:
    """One key's account; ``recorded + dropped`` is what arrived at the logger."""

    recorded: int = 0
    dropped: int = 0
    gaps: int = 0
    """Messages missing by sequence number: lost on their way, or dropped by the logger."""
    headerless: int = 0
    """Recorded as they came, but without a readable header."""


class Tally:
    """Accounts of all keys."""

    def __init__(self) -> None:
        """Start with no keys."""
        self._counts: dict[str, KeyCount] = {}
        self._sequences: dict[str, SequenceTracker] = {}

    def record(self, key: str, header: Header | None) -> None:
        """Note one recorded message."""
        count = self._counts.setdefault(key, KeyCount())
        count.recorded += 1
        if header is None:
            count.headerless += 1
            return
        sequence = self._sequences.setdefault(key, SequenceTracker())
        sequence.observe(header)
        count.gaps = sequence.missing

    def report(self, dropped: Mapping[str, int]) -> dict[str, KeyCount]:
        """The account with the intake's drops filled in, by key."""
        keys = sorted({*self._counts, *dropped})
        report = {key: KeyCount(**asdict(self._counts.get(key, KeyCount()))) for key in keys}
        for key, count in dropped.items():
            report[key].dropped = count
        return report


def format_report(report: Mapping[str, KeyCount]) -> str:
    """A table of the report for a person, with a line of totals."""
    width = max([len(key) for key in report] + [5])
    lines = [f"{'topic':<{width}} {'recorded':>9} {'dropped':>8} {'gaps':>6} {'headerless':>10}"]
    rows = [*report.items(), ("total", _total(report))]
    lines += [
        f"{key:<{width}} {c.recorded:>9} {c.dropped:>8} {c.gaps:>6} {c.headerless:>10}"
        for key, c in rows
    ]
    return "\n".join(lines)


def _total(report: Mapping[str, KeyCount]) -> KeyCount:
    counts = list(report.values())
    return KeyCount(
        *(
            sum(getattr(count, name) for count in counts)
            for name in ("recorded", "dropped", "gaps", "headerless")
        )
    )


def to_metadata(report: Mapping[str, KeyCount]) -> dict[str, str]:
    """The report as MCAP metadata: key to JSON."""
    return {key: json.dumps(asdict(count)) for key, count in report.items()}


def from_metadata(metadata: Mapping[str, str]) -> dict[str, KeyCount]:
    """Inverse of :func:`to_metadata`.

    Raises:
        LoggerError: the metadata is not such a report.
    """
    try:
        return {key: KeyCount(**json.loads(text)) for key, text in metadata.items()}
    except (ValueError, TypeError) as error:
        raise LoggerError(
            f"the log's report is unreadable: expected counts by topic, got {dict(metadata)}"
        ) from error
