"""The latency ledger: where the time of every message a service took in went, from journals. Pure.

The same stages as in :class:`~common.schemas.StageTime`, of every message of the log, by consumer
and topic; and for each link that injects delay what was asked for, what was done and what was lost.
"""

from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from common.errors import TrillError
from common.journal.journal import (
    TAKE_COLUMNS,
    Table,
    Take,
    read_tables,
    stage_durations,
    stage_times,
)
from common.links.spec import LinkSpec
from common.links.summary import requested
from common.schemas import LinkChange, ServiceHealth, StageTime, StepJournal

STAGES = ("capture", "encode", "wire", "injected", "queue", "decode", "use", "total")

Durations = npt.NDArray[np.float64]

_KIND = TAKE_COLUMNS.index("kind")
_TIMES = slice(TAKE_COLUMNS.index("captured"), TAKE_COLUMNS.index("decode") + 1)
_ARRIVAL, _INJECTED = 3, 4
"""Columns of an input's rows."""


@dataclass(frozen=True)
class LedgerRow:
    """One input of one service."""

    consumer: str
    topic: str
    counts: dict[Take, int]
    stages: tuple[StageTime, ...]
    samples: dict[str, Durations] = field(repr=False)
    """Every message's time in each stage [s]; of those applied."""

    @property
    def applied(self) -> int:
        """Messages the service used."""
        return self.counts.get(Take.APPLIED, 0)


@dataclass(frozen=True)
class LinkRow:
    """One link while one delay was set; durations in seconds, NaN where not known."""

    consumer: str
    topic: str
    link: str
    requested_mean: float
    requested_p99: float
    achieved_mean: float
    achieved_p99: float
    passed: int
    lost: int


@dataclass
class _Input:
    """Rows of one input: a take's times, its step's start, results sent; and their kinds."""

    rows: list[Table] = field(default_factory=list)
    kinds: list[Table] = field(default_factory=list)
    changes: list[tuple[int, str]] = field(default_factory=list)


class Ledger:
    """Collects journals and what is known about links, in the order of a log."""

    def __init__(self) -> None:
        """Start empty."""
        self._inputs: dict[tuple[str, str], _Input] = {}
        self._requested: dict[str, tuple[float, float]] = {}
        self.unreadable = 0
        """Journals whose tables contradict themselves."""

    def add(self, journal: StepJournal, begin_ns: int = 0, end_ns: int = 2**63 - 1) -> None:
        """Take in a journal; only steps that began within a span of the consumer's clock."""
        try:
            steps, takes = read_tables(journal)
        except TrillError:
            self.unreadable += 1
            return
        if not len(takes):
            return
        used = steps[takes[:, 0]]
        inside = (used[:, 0] >= begin_ns) & (used[:, 0] < end_ns)
        rows = np.column_stack([takes[:, _TIMES], used])
        for number, stream in enumerate(journal.streams):
            mine = inside & (takes[:, 1] == number)
            if mine.any():
                account = self._input(journal.service, stream.topic)
                account.rows.append(rows[mine])
                account.kinds.append(takes[mine, _KIND])

    def note_change(self, change: LinkChange) -> None:
        """A link was set at a time of the consumer's clock."""
        account = self._input(change.service, change.topic)
        account.changes.append((change.header.sent, change.link))

    def note_health(self, health: ServiceHealth) -> None:
        """What links are in force, as their service says; finds what no change told of."""
        for link in health.links:
            if link.link:
                self._requested[link.link] = (link.requested_mean, link.requested_p99)
            account = self._inputs.get((health.service, link.topic))
            last = account.changes[-1][1] if account is not None and account.changes else ""
            if link.link != last:
                account = self._input(health.service, link.topic)
                account.changes.append((health.header.sent, link.link))

    def rows(self) -> list[LedgerRow]:
        """Every input that took in something, by consumer and topic."""
        result = []
        for (consumer, topic), account in sorted(self._inputs.items()):
            if not account.rows:
                continue
            rows, kinds = _joined(account)
            applied = rows[kinds == Take.APPLIED]
            result.append(
                LedgerRow(
                    consumer=consumer,
                    topic=topic,
                    counts={Take(kind): n for kind, n in Counter(kinds.tolist()).items()},
                    stages=tuple(stage_times(applied)),
                    samples={
                        name: np.asarray(1e-9 * some, np.float64)
                        for name, some in stage_durations(applied).items()
                    },
                )
            )
        return result

    def links(self) -> list[LinkRow]:
        """Every delay that was in force while something arrived."""
        result = []
        for (consumer, topic), account in sorted(self._inputs.items()):
            if not account.rows or not account.changes:
                continue
            rows, kinds = _joined(account)
            ordered = sorted(account.changes)
            # A change may be told of twice, by the change and by the health after it.
            changes = [now for last, now in pairwise([(0, None), *ordered]) if last[1] != now[1]]
            # Before the first that was told of there is no telling; it is taken to hold already.
            bounds = [-(2**62), *(at for at, _ in changes[1:]), 2**62]
            for (begin, end), (_, link) in zip(pairwise(bounds), changes, strict=True):
                part = (rows[:, _ARRIVAL] >= begin) & (rows[:, _ARRIVAL] < end)
                if link and part.any():
                    result.append(self._link(consumer, topic, link, rows[part], kinds[part]))
        return result

    def _link(
        self, consumer: str, topic: str, link: str, rows: Table, kinds: npt.NDArray[np.int64]
    ) -> LinkRow:
        lost = kinds == Take.LOST
        achieved = 1e-9 * rows[~lost, _INJECTED]
        mean, p99 = self._requested.get(link) or _parsed(link)
        return LinkRow(
            consumer=consumer,
            topic=topic,
            link=link,
            requested_mean=mean,
            requested_p99=p99,
            achieved_mean=float(achieved.mean()) if len(achieved) else np.nan,
            achieved_p99=float(np.percentile(achieved, 99)) if len(achieved) else np.nan,
            passed=len(achieved),
            lost=int(lost.sum()),
        )

    def _input(self, consumer: str, topic: str) -> _Input:
        return self._inputs.setdefault((consumer, topic), _Input())


def _joined(account: _Input) -> tuple[Table, npt.NDArray[np.int64]]:
    return np.concatenate(account.rows), np.concatenate(account.kinds)


def _parsed(link: str) -> tuple[float, float]:
    try:
        asked = requested(LinkSpec.parse(link))
    except TrillError:
        return np.nan, np.nan
    return asked.mean, asked.p99
