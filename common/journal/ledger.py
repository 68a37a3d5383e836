"""Compute the latency breakdown of a log from its journals, for ``trill ledger``; pure.

Each message that a service took in is accounted by consumer and topic, with the time that it spent
in each stage of :class:`~common.schemas.StageTime`. For each link that injects delay, the breakdown
also has the requested and the achieved delay and the number of lost messages.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from common.errors import TrillError
from common.journal.stages import STAGES, stage_columns, stage_time_of
from common.journal.tables import INPUT_COLUMNS, UNKNOWN, InputOutcome, Table, read_tables
from common.links.spec import LinkSpec
from common.links.summary import requested
from common.order_statistics import Numbers, Parts, quantiles
from common.schemas import LinkChange, ServiceHealth, StageTime, StepJournal
from common.spool import Spool

Durations = npt.NDArray[np.float64]

_STEP, _SOURCE, _OUTCOME = (INPUT_COLUMNS.index(name) for name in ("step", "source", "outcome"))
_TIMES = slice(INPUT_COLUMNS.index("captured"), INPUT_COLUMNS.index("decode") + 1)
_ARRIVED = 3
"""The arrival among these times."""
_INJECTED, _ARRIVAL, _RESULT = STAGES.index("injected"), len(STAGES), len(STAGES) + 1
"""Columns of :attr:`_Input.rows`."""


@dataclass(frozen=True)
class LedgerRow:
    """The latency breakdown of one input of one service."""

    consumer: str
    topic: str
    counts: dict[InputOutcome, int]
    stages: tuple[StageTime, ...]
    samples: Mapping[str, Durations] = field(repr=False)
    """Time of each applied message in each stage [s], computed whenever it is asked for."""

    @property
    def applied(self) -> int:
        """Messages the service used."""
        return self.counts.get(InputOutcome.APPLIED, 0)


@dataclass(frozen=True)
class LinkRow:
    """The delay of one link during the time for which one specification was in force.

    Durations are in seconds, and NaN where they are not known.
    """

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
    """Records of one input of one service.

    Attributes:
        rows: a row per input record: its time in each stage, its arrival [ns], its outcome.
        changes: the time [ns] and the new link of each change of the link.
    """

    rows: Spool = field(default_factory=lambda: Spool(len(STAGES) + 2, "q"))
    changes: list[tuple[int, str]] = field(default_factory=list)

    def add(self, rows: Table, outcomes: Table) -> None:
        """Add records: times and step as for :func:`stage_columns`."""
        times = stage_columns(rows).values()
        self.rows.add(np.column_stack([*times, rows[:, _ARRIVED], outcomes]))

    def counts(self) -> dict[InputOutcome, int]:
        """Return the number of records of each outcome."""
        counts: Counter[int] = Counter()
        for (part,) in self.rows.parts(_RESULT):
            kinds, numbers = np.unique(part, return_counts=True)
            counts.update(dict(zip(kinds.tolist(), numbers.tolist(), strict=True)))
        return {InputOutcome(kind): counts[kind] for kind in sorted(counts)}

    def applied(self, stage: str) -> Iterator[Numbers]:
        """Yield the known times of the applied messages in a stage, in parts [ns]."""
        for some, outcome in self.rows.parts(STAGES.index(stage), _RESULT):
            yield some[(outcome == InputOutcome.APPLIED) & (some != UNKNOWN)]

    def achieved(self, begin: int, end: int) -> Iterator[Numbers]:
        """Yield the injected delays of what arrived, and was not lost, in a span of time [ns]."""
        for arrival, injected, outcome in self.rows.parts(_ARRIVAL, _INJECTED, _RESULT):
            inside = (arrival >= begin) & (arrival < end)
            yield injected[inside & (outcome != InputOutcome.LOST)]

    def lost(self, begin: int, end: int) -> int:
        """Return the number of messages that were lost in a span of time."""
        return sum(
            int(((arrival >= begin) & (arrival < end) & (outcome == InputOutcome.LOST)).sum())
            for arrival, outcome in self.rows.parts(_ARRIVAL, _RESULT)
        )


@dataclass(frozen=True)
class _Samples(Mapping[str, Durations]):
    """Times by stage [s], which would take much memory together."""

    account: _Input

    def __getitem__(self, stage: str) -> Durations:
        return np.concatenate([1e-9 * part for part in self.account.applied(stage)])

    def __iter__(self) -> Iterator[str]:
        return iter(STAGES)

    def __len__(self) -> int:
        return len(STAGES)


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
                account.add(rows[chosen], inputs[chosen, _OUTCOME])

    def note_change(self, change: LinkChange) -> None:
        """Note that a link was set, at a time of the consumer's clock."""
        account = self._input(change.service, change.topic)
        account.changes.append((change.header.sent, change.link))

    def note_health(self, health: ServiceHealth) -> None:
        """Note the links that a service reports as in force, whether or not it announced them."""
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
            if not len(account.rows):
                continue
            times = (stage_time_of(name, partial(account.applied, name)) for name in STAGES)
            stages = tuple(time for time in times if time is not None)
            counts = account.counts()
            result.append(LedgerRow(consumer, topic, counts, stages, _Samples(account)))
        return result

    def links(self) -> list[LinkRow]:
        """Return the delays that were in force while messages arrived."""
        result = []
        for (consumer, topic), account in sorted(self._inputs.items()):
            if not len(account.rows) or not account.changes:
                continue
            ordered = sorted(account.changes)
            # A change may be noted twice, from its own message and from the health after it.
            changes = [now for last, now in pairwise([(0, None), *ordered]) if last[1] != now[1]]
            # Nothing is known before the first change; its link is assumed to have held already.
            bounds = [-(2**62), *(at for at, _ in changes[1:]), 2**62]
            for (begin, end), (_, link) in zip(pairwise(bounds), changes, strict=True):
                if not link:
                    continue
                achieved, lost = partial(account.achieved, begin, end), account.lost(begin, end)
                row = self._link(consumer, topic, link, achieved, lost)
                if row.passed or row.lost:
                    result.append(row)
        return result

    def _link(self, consumer: str, topic: str, link: str, achieved: Parts, lost: int) -> LinkRow:
        mean, p99 = self._requested.get(link) or _parsed(link)
        passed = sum(map(len, achieved()))
        total = sum(float(part.sum()) for part in achieved())
        return LinkRow(
            consumer=consumer,
            topic=topic,
            link=link,
            requested_mean=mean,
            requested_p99=p99,
            achieved_mean=1e-9 * total / passed if passed else np.nan,
            achieved_p99=1e-9 * quantiles(achieved, passed, (0.99,))[0] if passed else np.nan,
            passed=passed,
            lost=lost,
        )

    def _input(self, consumer: str, topic: str) -> _Input:
        return self._inputs.setdefault((consumer, topic), _Input())


def _parsed(link: str) -> tuple[float, float]:
    try:
        asked = requested(LinkSpec.parse(link))
    except TrillError:
        return np.nan, np.nan
    return asked.mean, asked.p99
