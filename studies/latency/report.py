"""From the trials of a study to its files and what is printed."""

from dataclasses import dataclass

from studies.latency.figure import draw
from studies.latency.finding import Finding, find
from studies.latency.plan import Plan
from studies.latency.stats import CellSummary, summarise
from studies.latency.store import Store
from studies.latency.tables import write_summary, write_trials

FIGURE = "latency.png"


@dataclass(frozen=True)
class Report:
    """What was written.

    Attributes:
        plan: of the study.
        cells: every condition of every task.
        finding: the conclusion.
    """

    plan: Plan
    cells: list[CellSummary]
    finding: Finding


def write_report(store: Store) -> Report | None:
    """Make every file from what is in the directory; None: no trial is there yet.

    Raises:
        LatencyStudyError: there is no study, or it cannot be read.
        ConfigError: matplotlib is not installed.
    """
    plan = store.plan()
    place = {condition.name: i for i, condition in enumerate(plan.conditions)}
    rows = sorted(
        [*store.rows(), *store.human_rows()],
        key=lambda r: (
            r.operator != "synthetic",
            r.task,
            place[r.condition],
            r.participant,
            r.seed,
        ),
    )
    if not rows:
        return None
    cells = summarise(rows, list(place), plan.baseline.name)
    finding = find(plan, rows)
    write_trials(store.root / "trials.csv", rows)
    write_summary(store.root, plan, cells, finding, {})
    draw(store.root / FIGURE, plan, rows, cells)
    return Report(plan, cells, finding)
