"""When messages arrived, what was injected and when a step had them, from consumers' journals."""

from dataclasses import dataclass, field
from functools import cache

from common.journal.journal import Take, read_tables
from common.links.predict import Figures, figures, predict, requested_figures
from common.links.spec import LinkSpec
from common.schemas import StepJournal
from verification.links.parts import RATE

ON_TIME = 0.001
"""A wake-up this late at most [s] is on time."""

_TAKEN = {int(Take.APPLIED), int(Take.LATE)}


@dataclass
class Takes:
    """Messages of one consumer, each (arrival, injected, time of the step that had it) [ns]."""

    rows: list[tuple[int, int, int]] = field(default_factory=list)

    def add(self, journal: StepJournal) -> None:
        """Take in a journal message.

        Raises:
            SchemaError: it contradicts itself.
        """
        steps, takes = read_tables(journal)
        for take in takes.tolist():
            if take[2] in _TAKEN:
                self.rows.append((take[7], take[8], int(steps[take[0]][0])))

    def between(self, start_ns: int, end_ns: int) -> "Takes":
        """Those that arrived in a span."""
        return Takes([row for row in self.rows if start_ns <= row[0] < end_ns])

    @property
    def achieved(self) -> list[float]:
        """From arriving at the consumer's transport to the step that had it [s]."""
        return [1e-9 * (step - arrival) for arrival, _, step in self.rows]

    @property
    def drawn(self) -> list[float]:
        """What the line was to inject, keeping order included [s]."""
        return [1e-9 * injected for _, injected, _ in self.rows]

    @property
    def errors(self) -> list[float]:
        """How much later than that the step had it [s]."""
        return [1e-9 * (step - arrival - injected) for arrival, injected, step in self.rows]


@dataclass(frozen=True)
class Result:
    """One line of the study; durations in seconds."""

    where: str
    consumer: str
    link: str
    messages: int
    requested: Figures
    predicted: Figures
    drawn: Figures
    achieved: Figures
    error_p50: float
    error_p99: float
    on_time: float
    """Share of the messages at most :data:`ON_TIME` late."""


@cache
def _foretold(spec: LinkSpec) -> Figures:
    return predict(spec, RATE).predicted


def result(where: str, consumer: str, link: str, takes: Takes) -> Result:
    """Sum up what one consumer saw of one link."""
    spec = LinkSpec.parse(link)
    errors = figures([abs(error) for error in takes.errors])
    on_time = sum(abs(error) <= ON_TIME for error in takes.errors)
    return Result(
        where=where,
        consumer=consumer,
        link=link,
        messages=len(takes.rows),
        requested=requested_figures(spec),
        predicted=_foretold(spec),
        drawn=figures(takes.drawn),
        achieved=figures(takes.achieved),
        error_p50=errors.p50,
        error_p99=errors.p99,
        on_time=on_time / max(1, len(takes.rows)),
    )
