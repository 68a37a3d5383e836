"""From the trials of a study to its files and what is printed."""

from dataclasses import dataclass

from lab.errors import LatencyStudyError
from lab.studies.latency.figure import draw
from lab.studies.latency.finding import Finding, find
from lab.studies.latency.plan import Plan
from lab.studies.latency.stats import CellSummary, summarise
from lab.studies.latency.store import SHEETS, Store
from lab.studies.latency.tables import write_summary, write_trials, write_workload
from lab.studies.latency.tlx import Workload, read_sheets, summarise_sheets

FIGURE = "latency.png"


@dataclass(frozen=True)
class Report:
    """What was written.

    Attributes:
        plan: of the study.
        cells: every condition of every task.
        workload: of the answer sheets.
        finding: the conclusion.
        files: names of what was written.
    """

    plan: Plan
    cells: list[CellSummary]
    workload: list[Workload]
    finding: Finding
    files: tuple[str, ...]


def write_report(store: Store) -> Report | None:
    """Make every file from what is in the directory; None: no trial is there yet.

    Raises:
        LatencyStudyError: there is no study, it cannot be read, or the files cannot be written.
        ConfigError: matplotlib is not installed.
    """
    plan = store.plan()
    place = {condition.name: i for i, condition in enumerate(plan.conditions)}
    rows, sheets = [*store.rows(), *store.human_rows()], read_sheets(store.root / SHEETS)
    if not rows and not sheets:
        return None
    for task, condition in {
        *((row.task, row.condition) for row in rows),
        *((sheet.task, sheet.condition) for sheet in sheets),
    }:
        if task not in plan.tasks or condition not in place:
            raise LatencyStudyError(
                f"{store.root} has a trial or sheet of {task} under {condition}, which is not in "
                f"its plan: expected {', '.join(plan.tasks)} under {', '.join(place)}"
            )
    rows.sort(
        key=lambda r: (
            r.operator != "synthetic",
            plan.tasks.index(r.task),
            place[r.condition],
            r.participant,
            r.seed,
        )
    )
    cells = summarise(rows, list(place), plan.baseline.name)
    workload = summarise_sheets(sheets, plan.tasks, list(place))
    finding = find(plan, rows)
    files = ["trials.csv", "summary.csv", "summary.json", FIGURE]
    try:
        write_trials(store.root / "trials.csv", rows)
        write_summary(store.root, plan, cells, finding, workload)
        if workload:
            write_workload(store.root / "workload.csv", workload)
            files.insert(2, "workload.csv")
        draw(store.root / FIGURE, plan, rows, cells, sheets)
    except OSError as error:
        raise LatencyStudyError(
            f"cannot write the report in {store.root}: {error.strerror or error}; the trials are "
            f"kept: mend it and give trill study latency --report {store.root}"
        ) from error
    return Report(plan, cells, workload, finding, tuple(files))
