"""Arrival, injected delay and use of messages, from the journals of their consumers."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from common.journal.journal import TAKE_COLUMNS, Take, read_tables
from common.links.predict import predict
from common.links.spec import LinkSpec
from common.links.summary import DelaySummary, requested, summarize
from common.schemas import StepJournal
from verification.links.parts import RATE

ON_TIME_S = 0.001
"""A message that a step has at most this late is on time."""

Seconds = npt.NDArray[np.float64]

_STEP, _KIND, _ARRIVAL, _INJECTED = map(TAKE_COLUMNS.index, ("step", "kind", "arrival", "injected"))


class Records:
    """Messages of one consumer, each as (arrival, injected delay, time of its step) [ns]."""

    def __init__(self, rows: npt.NDArray[np.int64] | None = None) -> None:
        """Begin with ``rows`` (n, 3), or with none."""
        self.rows = np.empty((0, 3), np.int64) if rows is None else rows

    def add(self, journal: StepJournal) -> None:
        """Append the messages of a journal that came through the link.

        Raises:
            SchemaError: the journal contradicts itself.
        """
        steps, takes = read_tables(journal)
        takes = takes[np.isin(takes[:, _KIND], (Take.APPLIED, Take.LATE))]
        rows = np.column_stack([takes[:, [_ARRIVAL, _INJECTED]], steps[takes[:, _STEP], 0]])
        self.rows = np.concatenate([self.rows, rows])

    def between(self, start_ns: int, end_ns: int) -> "Records":
        """Return the messages that arrived in a span."""
        arrival = self.rows[:, 0]
        return Records(self.rows[(start_ns <= arrival) & (arrival < end_ns)])

    @property
    def achieved(self) -> Seconds:
        """Time from the arrival at the consumer's transport to the step that has the message."""
        return np.asarray(1e-9 * (self.rows[:, 2] - self.rows[:, 0]), np.float64)

    @property
    def injected(self) -> Seconds:
        """Delay that the line injects, keeping order included."""
        return np.asarray(1e-9 * self.rows[:, 1], np.float64)

    @property
    def late(self) -> Seconds:
        """How much later than that the step has the message."""
        return np.asarray(1e-9 * (self.rows[:, 2] - self.rows[:, 0] - self.rows[:, 1]), np.float64)


@dataclass(frozen=True)
class Measurement:
    """The messages that one consumer received over one link.

    Attributes:
        where: ``live`` or ``simulated``.
        consumer: how the consumer reads.
        link: specification of the link.
        records: the messages.
    """

    where: str
    consumer: str
    link: str
    records: Records

    @property
    def requested(self) -> DelaySummary:
        """The distribution as written."""
        return requested(LinkSpec.parse(self.link))

    @property
    def predicted(self) -> DelaySummary:
        """The distribution that ``trill latency explain`` predicts."""
        return _predicted(self.link)

    @property
    def achieved(self) -> DelaySummary:
        """The distribution that the consumer saw."""
        return summarize(self.records.achieved)

    @property
    def late(self) -> DelaySummary:
        """How far the steps are from the injected delays."""
        return summarize(np.abs(self.records.late))

    @property
    def on_time(self) -> float:
        """Share of the messages at most :data:`ON_TIME_S` late."""
        late = np.abs(self.records.late)
        return float(np.mean(late <= ON_TIME_S)) if len(late) else 0.0

    def as_json(self) -> dict[str, Any]:
        """Return all figures; durations in seconds."""
        return {
            "where": self.where,
            "consumer": self.consumer,
            "link": self.link,
            "messages": len(self.records.rows),
            "requested": self.requested._asdict(),
            "predicted": self.predicted._asdict(),
            "injected": summarize(self.records.injected)._asdict(),
            "achieved": self.achieved._asdict(),
            "late": self.late._asdict(),
            "on_time": self.on_time,
        }


@cache
def _predicted(link: str) -> DelaySummary:
    return predict(LinkSpec.parse(link), RATE).predicted
