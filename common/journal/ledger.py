"""Break the latency of every message a service took in down by stage, from journals. Pure.

The stages are those of :class:`~common.schemas.StageTime`, for every message of the log, by
consumer and topic. For each link that injects delay: requested and achieved delay, and losses.
"""

from collections import Counter
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from common.errors import TrillError
from common.journal.stages import stage_durations, stage_times
from common.journal.tables import INPUT_COLUMNS, InputOutcome, Table, read_tables
from common.links.spec import LinkSpec
from common.links.summary import requested
from common.schemas import LinkChange, ServiceHealth, StageTime, StepJournal

STAGES = ("capture", "encode", "wire", "injected", "queue", "decode", "use", "total")

Durations = npt.NDArray[np.float64]

_STEP, _SOURCE, _OUTCOME = (INPUT_COLUMNS.index(name) for name in ("step", "source", "outcome"))
_TIMES = slice(INPUT_COLUMNS.index("captured"), INPUT_COLUMNS.index("decode") + 1)
_ARRIVAL, _INJECTED = 3, 4
"""Columns of :attr:`_Input.rows`."""


@dataclass(frozen=True)
class LedgerRow:
    """One input of one service."""

    consumer: str
    topic: str
    counts: dict[InputOutcome, int]
    stages: tuple[StageTime, ...]
    samples: dict[str, Durations] = field(repr=False)
    """Time of each applied message in each stage [s]."""

    @property
    def applied(self) -> int:
        """Messages the service used."""
        return self.counts.get(InputOutcome.APPLIED, 0)


@dataclass(frozen=True)
class LinkRow:
    """One link for as long as one delay was set; durations in seconds, NaN where not known."""

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
    """One input of one service.

    Attributes:
        rows: of input records: times, start of the step, results sent [ns].
        outcomes: of the same records.
        changes: time [ns] and link, of each change of the link.
    """

    rows: list[Table] = field(default_factory=list)
    outcomes: list[Table] = field(default_factory=list)
    changes: list[tuple[int, str]] = field(default_factory=list)


class Ledger:
    """Collects journals, link changes and health messages in the order of a log."""

    def __init__(self) -> None:
        """Start empty."""
        self._inputs: dict[tuple[str, str], _Input] = {}
        self._requested: dict[str, tuple[float, float]] = {}
        self.unreadable = 0
        """Journals whose tables contradict themselves."""

    def add(self, journal: StepJournal, begin_ns: int = 0, end_ns: int = 2**63 - 1) -> None:
        """Add the steps of a journal that began within a span of the consumer's clock."""
        try:
            steps, inputs = read_tables(journal)
        except TrillError:
            self.unreadable += 1
            return
        if not len(inputs):
            return
        used = steps[inputs[:, _STEP]]
        inside = (used[:, 0] >= begin_ns) & (used[:, 0] < end_ns)
        rows = np.column_stack([inputs[:, _TIMES], used])
        for index, source in enumerate(journal.sources):
            chosen = inside & (inputs[:, _SOURCE] == index)
            if chosen.any():
                account = self._input(journal.service, source.topic)
                account.rows.append(rows[chosen])
                account.outcomes.append(inputs[chosen, _OUTCOME])

    def note_change(self, change: LinkChange) -> None:
        """Note that a link was set, at a time of the consumer's clock."""
        account = self._input(change.service, change.topic)
        account.changes.append((change.header.sent, change.link))

    def note_health(self, health: ServiceHealth) -> None:
        """Note which links are in force according to their service, announced or not."""
        for link in health.links:
            if link.link:
                self._requested[link.link] = (link.requested_mean, link.requested_p99)
            account = self._inputs.get((health.service, link.topic))
            last = account.changes[-1][1] if account is not None and account.changes else ""
            if link.link != last:
                account = self._input(health.service, link.topic)
                account.changes.append((health.header.sent, link.link))

    def rows(self) -> list[LedgerRow]:
        """Return the inputs that received messages, by consumer and topic."""
        result = []
        for (consumer, topic), account in sorted(self._inputs.items()):
            if not account.rows:
                continue
            rows, outcomes = _joined(account)
            applied = rows[outcomes == InputOutcome.APPLIED]
            result.append(
                LedgerRow(
                    consumer=consumer,
                    topic=topic,
                    counts={InputOutcome(o): n for o, n in Counter(outcomes.tolist()).items()},
                    stages=tuple(stage_times(applied)),
                    samples={
                        name: np.asarray(1e-9 * some, np.float64)
                        for name, some in stage_durations(applied).items()
                    },
                )
            )
        return result

    def links(self) -> list[LinkRow]:
        """Return the delays that were in force while messages arrived."""
        result = []
        for (consumer, topic), account in sorted(self._inputs.items()):
            if not account.rows or not account.changes:
                continue
            rows, outcomes = _joined(account)
            ordered = sorted(account.changes)
            # A change may be noted twice, from its own message and from the health after it.
            changes = [now for last, now in pairwise([(0, None), *ordered]) if last[1] != now[1]]
            # Nothing is known before the first change; its link is assumed to have held already.
            bounds = [-(2**62), *(at for at, _ in changes[1:]), 2**62]
            for (begin, end), (_, link) in zip(pairwise(bounds), changes, strict=True):
                part = (rows[:, _ARRIVAL] >= begin) & (rows[:, _ARRIVAL] < end)
                if link and part.any():
                    result.append(self._link(consumer, topic, link, rows[part], outcomes[part]))
        return result

    def _link(self, consumer: str, topic: str, link: str, rows: Table, outcomes: Table) -> LinkRow:
        lost = outcomes == InputOutcome.LOST
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


def _joined(account: _Input) -> tuple[Table, Table]:
    return np.concatenate(account.rows), np.concatenate(account.outcomes)


def _parsed(link: str) -> tuple[float, float]:
    try:
        asked = requested(LinkSpec.parse(link))
    except TrillError:
        return np.nan, np.nan
    return asked.mean, asked.p99
