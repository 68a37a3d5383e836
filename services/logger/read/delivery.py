"""Delivery statistics of each key: every message sent was recorded, lost or dropped.

What was sent follows from the sequence numbers of each stream, which is one run of one publisher:
all numbers from the first to the last that was seen. Numbers that were neither recorded nor dropped
by the logger were lost on the way. So ``sent = recorded + lost + dropped`` holds exactly.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

from common.schemas import Header
from services.logger.errors import LoggerError
from services.logger.read.ranges import Ranges

MAX_JUMP = 1_000_000
"""A sequence number further off than this is a damaged message, not a million lost ones."""
MAX_GAP = 1000
"""One number alone at either end and further off than this is a stray one, too; several are not."""
MAX_STREAMS = 256
"""Streams told apart per key; a key with more is being flooded with garbage."""


@dataclass
class DeliveryCount:
    """How many messages of one key, or of several, were delivered.

    ``sent`` is ``recorded + lost + dropped``. The file has ``recorded + repeated`` messages.
    """

    recorded: int = 0
    """Different messages in the file."""
    dropped: int = 0
    """Messages that arrived while the logger's queue was full, and were not recorded."""
    lost: int = 0
    """Messages missing by sequence number that never arrived."""
    repeated: int = 0
    """Messages recorded again under a sequence number that was recorded before."""
    late: int = 0
    """Messages recorded after one with a higher sequence number."""
    headerless: int = 0
    """Recorded messages without a usable header; losses among them cannot be seen."""
    earlier: int = 0
    """Messages sent before the first one seen of their stream; not part of ``sent``."""
    bytes: int = 0
    """Size of the recorded messages' payloads."""
    first_ns: int = 0
    last_ns: int = 0
    """Arrival of the first and the last recorded message, monotonic clock."""

    @property
    def missing(self) -> int:
        """Messages that were sent and are not in the file."""
        return self.lost + self.dropped

    @property
    def sent(self) -> int:
        """Messages that the publishers sent between the first and the last one seen."""
        return self.recorded + self.missing

    def __add__(self, later: "DeliveryCount") -> "DeliveryCount":
        """Return the sum; its times reach from this one's first to the ``later`` one's last."""
        names = [one.name for one in fields(self)]
        sums = {name: getattr(self, name) + getattr(later, name) for name in names}
        sums["first_ns"] = self.first_ns or later.first_ns
        sums["last_ns"] = later.last_ns or self.last_ns
        return DeliveryCount(**sums)


@dataclass
class _Stream:
    """One run of one publisher of one key, by sequence numbers.

    ``sent`` is known to have been sent although the file may not hold it.
    """

    recorded: Ranges = field(default_factory=Ranges)
    dropped: Ranges = field(default_factory=Ranges)
    repeated: int = 0
    late: int = 0
    sent: Ranges = field(default_factory=Ranges)

    def span(self) -> tuple[int, int] | None:
        """Return the first and the last number seen, but for stray ones."""
        known = [numbers for numbers in (self.recorded, self.dropped, self.sent) if numbers]
        if not known:
            return None
        first = min(numbers.first for numbers in known)
        last = max(numbers.last for numbers in known)
        others = [end for numbers in known for end in numbers.without_ends()]
        if others and first not in others and min(others) - first > MAX_GAP:
            first = min(others)
        if others and last not in others and last - max(others) > MAX_GAP:
            last = max(others)
        return first, last

    def is_plausible(self, seq: int) -> bool:
        span = self.span()
        return span is None or span[0] - MAX_JUMP <= seq <= span[1] + MAX_JUMP

    def record(self, seq: int) -> None:
        late = bool(self.recorded) and seq < self.recorded.last
        if not self.recorded.add(seq):
            self.repeated += 1
        elif late:
            self.late += 1

    def count(self) -> DeliveryCount:
        span = self.span()
        if span is None:
            return DeliveryCount()
        first, last = span
        strays = self.recorded.ends_outside(first, last)
        # A message of which one copy was dropped and another recorded is in the file.
        dropped = len(self.dropped) - self.dropped.common(self.recorded)
        return DeliveryCount(
            recorded=len(self.recorded),
            dropped=dropped,
            lost=last
            - first
            + 1
            - (len(self.recorded) - strays)
            - max(0, dropped - self.dropped.ends_outside(first, last)),
            repeated=self.repeated,
            late=self.late,
            headerless=strays,
            earlier=first,
        )


@dataclass
class _Key:
    streams: dict[tuple[str, int], _Stream] = field(default_factory=dict)
    headerless: int = 0
    headerless_dropped: int = 0
    bytes: int = 0
    first_ns: int = 0
    last_ns: int = 0

    def stream_of(self, header: Header | None) -> _Stream | None:
        """Return the stream of a message; None if its header is unusable."""
        if header is None:
            return None
        name = (header.source, header.boot)
        stream = self.streams.get(name)
        if stream is None and len(self.streams) < MAX_STREAMS:
            stream = self.streams[name] = _Stream()
        if stream is None or stream.recorded.is_next(header.seq):
            return stream
        return stream if stream.is_plausible(header.seq) else None

    def count(self) -> DeliveryCount:
        return sum(
            (stream.count() for stream in self.streams.values()),
            DeliveryCount(
                recorded=self.headerless,
                dropped=self.headerless_dropped,
                headerless=self.headerless,
                bytes=self.bytes,
                first_ns=self.first_ns,
                last_ns=self.last_ns,
            ),
        )

    def state(self) -> dict[str, Any]:
        streams = [
            [*name, list(s.recorded), list(s.dropped), s.repeated, s.late, list(s.sent)]
            for name, s in self.streams.items()
        ]
        return {
            "streams": streams,
            "headerless": [self.headerless, self.headerless_dropped],
            "bytes": self.bytes,
            "time": [self.first_ns, self.last_ns],
        }

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> "_Key":
        streams = {
            (str(source), int(boot)): _Stream(
                Ranges(recorded), Ranges(dropped), repeated, late, Ranges(sent)
            )
            for source, boot, recorded, dropped, repeated, late, sent in state["streams"]
        }
        headerless, headerless_dropped = state["headerless"]
        first_ns, last_ns = state["time"]
        return cls(streams, headerless, headerless_dropped, state["bytes"], first_ns, last_ns)


class DeliveryStats:
    """Delivery statistics of all keys; not safe from several threads."""

    def __init__(self) -> None:
        """Start without keys."""
        self._keys: dict[str, _Key] = {}

    def __bool__(self) -> bool:
        return bool(self._keys)

    def record(self, key: str, header: Header | None, size: int = 0, at_ns: int = 0) -> None:
        """Count one recorded message of ``size`` bytes that arrived at ``at_ns``."""
        # Not setdefault: this is done for every message.
        stats = self._keys.get(key)
        if stats is None:
            stats = self._keys[key] = _Key()
        if not stats.first_ns:
            stats.first_ns = at_ns
        stats.last_ns = at_ns
        stats.bytes += size
        stream = stats.stream_of(header)
        if stream is None or header is None:
            stats.headerless += 1
        else:
            stream.record(header.seq)

    def drop(self, key: str, header: Header | None) -> None:
        """Count one message that arrived but will not be recorded."""
        stats = self._keys.setdefault(key, _Key())
        stream = stats.stream_of(header)
        if stream is None or header is None:
            stats.headerless_dropped += 1
        else:
            stream.dropped.add(header.seq)

    def add_drops(self, other: "DeliveryStats") -> None:
        """Add the messages that ``other`` counts as dropped."""
        for key, theirs in other._keys.items():
            stats = self._keys.setdefault(key, _Key())
            stats.headerless_dropped += theirs.headerless_dropped
            for name, stream in theirs.streams.items():
                ours = stats.streams.setdefault(name, _Stream())
                for first, last in stream.dropped:
                    if ours.is_plausible(first) and ours.is_plausible(last):
                        ours.dropped.add_run(first, last)
                    else:
                        stats.headerless_dropped += last - first + 1

    def add_sent(self, other: "DeliveryStats") -> None:
        """Count as sent what ``other`` has seen, whether it is recorded here or not."""
        for key, theirs in other._keys.items():
            stats = self._keys.setdefault(key, _Key())
            for name, stream in theirs.streams.items():
                span = stream.span()
                if span is not None:
                    stats.streams.setdefault(name, _Stream()).sent.add_run(*span)

    def report(self) -> dict[str, DeliveryCount]:
        """Return the counts by key."""
        return {key: self._keys[key].count() for key in sorted(self._keys)}

    def streams(self) -> dict[str, list[tuple[str, int]]]:
        """Return source and boot id of every stream seen, by key."""
        return {key: list(self._keys[key].streams) for key in sorted(self._keys)}

    def to_metadata(self) -> dict[str, str]:
        """Return everything as MCAP metadata: JSON by key."""
        return {key: json.dumps(stats.state()) for key, stats in self._keys.items()}

    @classmethod
    def from_metadata(cls, metadata: Mapping[str, str]) -> "DeliveryStats":
        """Restore what :meth:`to_metadata` returned.

        Raises:
            LoggerError: ``metadata`` has another form.
        """
        stats = cls()
        try:
            stats._keys = {key: _Key.from_state(json.loads(v)) for key, v in metadata.items()}
        except (ValueError, TypeError, KeyError) as error:
            raise LoggerError(
                f"the log's delivery statistics are unreadable ({error}); expected sequence "
                "numbers by topic"
            ) from error
        return stats


def total(report: Mapping[str, DeliveryCount]) -> DeliveryCount:
    """Return the sum over all keys."""
    return sum(report.values(), DeliveryCount())


_COLUMNS = ("sent", "recorded", "lost", "dropped", "repeated", "late", "headerless")


def format_report(report: Mapping[str, DeliveryCount]) -> str:
    """Return the report as a table for a person, with a line of totals."""
    width = max([len(key) for key in report] + [5])
    lines = [f"{'topic':<{width}} " + " ".join(f"{name:>10}" for name in _COLUMNS)]
    in_all = total(report)
    lines += [
        f"{key:<{width}} " + " ".join(f"{getattr(count, name):>10}" for name in _COLUMNS)
        for key, count in (*report.items(), ("total", in_all))
    ]
    lines.append("sent = recorded + lost (on the way) + dropped (here, because the queue was full)")
    if in_all.earlier:
        lines.append(f"{in_all.earlier} more were sent before this recorder could hear them")
    return "\n".join(lines)
