"""Writes the report of a study from its trials and answer sheets."""

from dataclasses import dataclass

from lab.errors import LatencyStudyError
from lab.studies.latency.criteria import Comparison, compare
from lab.studies.latency.figure import draw
from lab.studies.latency.plan import Plan
from lab.studies.latency.stats import CellSummary, summarise
from lab.studies.latency.store import SHEETS, StudyStore
from lab.studies.latency.tables import write_csv, write_summary, write_trials
from lab.studies.latency.tlx import Workload, read_sheets, summarise_sheets


@dataclass(frozen=True)
class Report:
    """A report that was written.

    Attributes:
        plan: plan of the study.
        cells: summary of every condition of every task.
        workload: summary of the answer sheets.
        comparisons: the criteria and whether they are met.
        files: names of the files.
    """

    plan: Plan
    cells: list[CellSummary]
    workload: list[Workload]
    comparisons: list[Comparison]
    files: tuple[str, ...]


def write_report(store: StudyStore) -> Report | None:
    """Write every file of the report; None: there is neither a trial nor a sheet yet.

    Raises:
        LatencyStudyError: there is no study, it cannot be read, or the files cannot be written.
        ConfigError: matplotlib is not installed.
    """
    plan = store.plan()
    order = {condition.name: i for i, condition in enumerate(plan.conditions)}
    trials = [*store.trials(), *store.human_trials()]
    sheets = read_sheets(store.root / SHEETS)
    if not trials and not sheets:
        return None
    found = {(trial.task, trial.condition) for trial in trials}
    for task, condition in found | {(sheet.task, sheet.condition) for sheet in sheets}:
        if task not in plan.tasks or condition not in order:
            raise LatencyStudyError(
                f"{store.root} has a trial or sheet of {task} under {condition}, which is not in "
                f"its plan: expected {', '.join(plan.tasks)} under {', '.join(order)}"
            )
    trials.sort(
        key=lambda t: (
            t.operator != "synthetic",
            plan.tasks.index(t.task),
            order[t.condition],
            t.participant,
            t.seed,
        )
    )
    cells = summarise(trials, list(order), plan.baseline.name)
    workload = summarise_sheets(sheets, plan.tasks, list(order))
    comparisons = compare(plan, trials)
    files = ["trials.csv", "summary.csv", "summary.json", "latency.png"]
    try:
        write_trials(store.root / "trials.csv", trials)
        write_summary(store.root, plan, cells, comparisons, workload)
        if workload:
            files.append("workload.csv")
            rows = (part.model_dump(exclude={"scales"}) | part.scales for part in workload)
            write_csv(store.root / "workload.csv", rows)
        draw(store.root / "latency.png", plan, trials, cells, sheets)
    except OSError as error:
        raise LatencyStudyError(
            f"cannot write the report in {store.root}: {error.strerror or error}; the trials are "
            f"kept: mend it and give trill study latency --report {store.root}"
        ) from error
    return Report(plan, cells, workload, comparisons, tuple(files))
