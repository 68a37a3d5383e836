"""The exact account of each key: what was sent is what was recorded, lost and dropped.

What was sent is known from the sequence numbers of each stream, one life of one publisher: all
numbers from the first heard of to the last. Those that were neither recorded nor dropped by the
logger itself were lost on their way.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from common.schemas import Header
from services.logger.errors import LoggerError
from services.logger.read.counts import KeyCount, format_report, from_metadata, to_metadata, total
from services.logger.read.ranges import Ranges

__all__ = ["KeyCount", "Tally", "format_report", "from_metadata", "to_metadata", "total"]

MAX_JUMP = 1_000_000
"""A number further off than this is a damaged message, not a million lost ones."""
MAX_STREAMS = 256
"""Publisher lives told apart per key; a key with more is being flooded with garbage."""


@dataclass
class _Stream:
    """One life of one publisher of one key: numbers recorded, and numbers dropped.

    ``heard`` is what was once heard of, but may have been lost from the file since.
    """

    recorded: Ranges = field(default_factory=Ranges)
    dropped: Ranges = field(default_factory=Ranges)
    repeated: int = 0
    late: int = 0
    heard: Ranges = field(default_factory=Ranges)

    def span(self) -> tuple[int, int] | None:
        """The first and the last number heard of."""
        known = [numbers for numbers in (self.recorded, self.dropped, self.heard) if numbers]
        if not known:
            return None
        return min(numbers.first for numbers in known), max(numbers.last for numbers in known)

    def is_plausible(self, seq: int) -> bool:
        span = self.span()
        return span is None or span[0] - MAX_JUMP <= seq <= span[1] + MAX_JUMP

    def record(self, seq: int) -> None:
        late = bool(self.recorded) and seq < self.recorded.last
        if not self.recorded.add(seq):
            self.repeated += 1
        elif late:
            self.late += 1

    def add_to(self, count: KeyCount) -> None:
        span = self.span()
        if span is None:
            return
        first, last = span
        # A message of which one copy was dropped and another recorded is there.
        dropped = len(self.dropped) - self.dropped.common(self.recorded)
        count.recorded += len(self.recorded)
        count.dropped += dropped
        count.lost += last - first + 1 - len(self.recorded) - dropped
        count.repeated += self.repeated
        count.late += self.late
        count.earlier += first


@dataclass
class _Key:
    streams: dict[tuple[str, int], _Stream] = field(default_factory=dict)
    headerless: int = 0
    headerless_dropped: int = 0
    bytes: int = 0
    first_ns: int = 0
    last_ns: int = 0

    def stream_of(self, header: Header | None) -> _Stream | None:
        """The stream of a message; None if its header is of no use."""
        if header is None:
            return None
        name = (header.source, header.boot)
        stream = self.streams.get(name)
        if stream is None and len(self.streams) < MAX_STREAMS:
            stream = self.streams[name] = _Stream()
        if stream is None or stream.recorded.is_next(header.seq):
            return stream
        return stream if stream.is_plausible(header.seq) else None

    def count(self) -> KeyCount:
        count = KeyCount(
            recorded=self.headerless,
            dropped=self.headerless_dropped,
            headerless=self.headerless,
            bytes=self.bytes,
            first_ns=self.first_ns,
            last_ns=self.last_ns,
        )
        for stream in self.streams.values():
            stream.add_to(count)
        return count


class Tally:
    """Accounts of all keys; not safe from several threads."""

    def __init__(self) -> None:
        """Start with no keys."""
        self._keys: dict[str, _Key] = {}

    def __bool__(self) -> bool:
        return bool(self._keys)

    def record(self, key: str, header: Header | None, size: int = 0, at_ns: int = 0) -> None:
        """Note one recorded message of ``size`` bytes that arrived at ``at_ns``."""
        account = self._keys.get(key)
        if account is None:
            account = self._keys[key] = _Key()
        if not account.first_ns:
            account.first_ns = at_ns
        account.last_ns = at_ns
        account.bytes += size
        stream = account.stream_of(header)
        if stream is None or header is None:
            account.headerless += 1
        else:
            stream.record(header.seq)

    def drop(self, key: str, header: Header | None) -> None:
        """Note one message that arrived but will not be recorded."""
        account = self._keys.setdefault(key, _Key())
        stream = account.stream_of(header)
        if stream is None or header is None:
            account.headerless_dropped += 1
        else:
            stream.dropped.add(header.seq)

    def add_drops(self, other: "Tally") -> None:
        """Take over what ``other`` says was dropped."""
        for name, theirs in other._keys.items():
            account = self._keys.setdefault(name, _Key())
            account.headerless_dropped += theirs.headerless_dropped
            for stream_name, stream in theirs.streams.items():
                ours = account.streams.setdefault(stream_name, _Stream())
                for first, last in stream.dropped:
                    if ours.is_plausible(first) and ours.is_plausible(last):
                        ours.dropped.add_run(first, last)
                    else:
                        account.headerless_dropped += last - first + 1

    def hear(self, other: "Tally") -> None:
        """Count as sent what ``other`` has heard of, recorded here or not."""
        for name, theirs in other._keys.items():
            account = self._keys.setdefault(name, _Key())
            for stream_name, stream in theirs.streams.items():
                span = stream.span()
                if span is not None:
                    ours = account.streams.setdefault(stream_name, _Stream())
                    ours.heard.add_run(*span)

    def report(self) -> dict[str, KeyCount]:
        """The accounts, by key."""
        return {key: self._keys[key].count() for key in sorted(self._keys)}

    def streams(self) -> dict[str, list[tuple[str, int]]]:
        """Source and boot of every publisher life heard of, by key."""
        return {key: list(self._keys[key].streams) for key in sorted(self._keys)}

    def state(self) -> dict[str, str]:
        """Everything, as MCAP metadata: key to JSON."""
        return {key: json.dumps(_key_state(account)) for key, account in self._keys.items()}

    @classmethod
    def from_state(cls, state: Mapping[str, str]) -> "Tally":
        """Inverse of :meth:`state`.

        Raises:
            LoggerError: ``state`` is not such a state.
        """
        tally = cls()
        try:
            tally._keys = {key: _key_from(json.loads(text)) for key, text in state.items()}
        except (ValueError, TypeError, KeyError) as error:
            raise LoggerError(
                f"the log's account is unreadable ({error}); expected sequence numbers by topic"
            ) from error
        return tally


def _key_state(account: _Key) -> dict[str, Any]:
    return {
        "streams": [
            [
                source,
                boot,
                list(one.recorded),
                list(one.dropped),
                one.repeated,
                one.late,
                list(one.heard),
            ]
            for (source, boot), one in account.streams.items()
        ],
        "headerless": [account.headerless, account.headerless_dropped],
        "bytes": account.bytes,
        "time": [account.first_ns, account.last_ns],
    }


def _key_from(state: dict[str, Any]) -> _Key:
    return _Key(
        streams={
            (str(source), int(boot)): _Stream(
                Ranges(recorded), Ranges(dropped), repeated, late, Ranges(heard)
            )
            for source, boot, recorded, dropped, repeated, late, heard in state["streams"]
        },
        headerless=state["headerless"][0],
        headerless_dropped=state["headerless"][1],
        bytes=state["bytes"],
        first_ns=state["time"][0],
        last_ns=state["time"][1],
    )
