"""Writes the report of a study, CSV, JSON and a figure, from its trials and answer sheets."""

import csv
import io
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from common.files import write_whole
from lab.errors import LatencyStudyError
from lab.studies.latency.criteria import CRITERIA, Comparison, compare, reproduced
from lab.studies.latency.figure import draw
from lab.studies.latency.plan import Plan
from lab.studies.latency.record import Record, StudyTrial
from lab.studies.latency.stats import CellSummary, summarise
from lab.studies.latency.store import SHEETS, StudyStore
from lab.studies.latency.tlx import Workload, read_sheets, summarise_sheets


class Report(Record):
    """A report, as ``summary.json`` has it.

    Attributes:
        plan: plan of the study.
        baseline: name of the condition that the others are compared with.
        cells: summary of every condition of every task.
        workload: summary of the answer sheets.
        criteria: the criteria in words.
        comparisons: comparisons by these criteria.
        reproduced: whether the criteria are met; None: there are too few trials to say so.
    """

    plan: Plan
    baseline: str
    cells: list[CellSummary]
    workload: list[Workload]
    criteria: str = CRITERIA
    comparisons: list[Comparison]
    reproduced: bool | None

    @property
    def files(self) -> tuple[str, ...]:
        """Names of the report's files."""
        extra = ("workload.csv",) if self.workload else ()
        return ("trials.csv", "summary.csv", "summary.json", "latency.png", *extra)


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
    comparisons = compare(plan, trials)
    report = Report(
        plan=plan,
        baseline=plan.baseline.name,
        cells=summarise(trials, list(order), plan.baseline.name),
        workload=summarise_sheets(sheets, plan.tasks, list(order)),
        comparisons=comparisons,
        reproduced=reproduced(comparisons),
    )
    try:
        # Durations are in seconds, latencies in milliseconds.
        _write_csv(store.root / "trials.csv", map(_trial_row, trials))
        _write_csv(store.root / "summary.csv", (cell.model_dump() for cell in report.cells))
        text = report.model_dump_json(indent=1) + "\n"
        write_whole(store.root / "summary.json", text.encode())
        if report.workload:
            rows = (part.model_dump(exclude={"scales"}) | part.scales for part in report.workload)
            _write_csv(store.root / "workload.csv", rows)
        draw(store.root / "latency.png", plan, trials, report.cells, sheets)
    except OSError as error:
        raise LatencyStudyError(
            f"cannot write the report in {store.root}: {error.strerror or error}; the trials are "
            f"kept: mend it and give trill study latency --report {store.root}"
        ) from error
    return report


def _write_csv(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write rows with the same keys, whole or not at all; nested values become columns."""
    text, flat = io.StringIO(), [_flatten(row) for row in rows]
    if flat:
        writer = csv.DictWriter(text, list(flat[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(flat)
    write_whole(path, text.getvalue().encode())


_WITH_UNIT = {
    "time": "time_s",
    "limit": "limit_s",
    "hand_path": "hand_path_m",
    "arm_acceleration": "arm_acceleration_rad_s2",
    "simulated": "simulated_s",
    "wall": "wall_s",
}
"""Columns of ``trials.csv`` that have a unit."""


def _trial_row(trial: StudyTrial) -> dict[str, Any]:
    row = trial.model_dump(exclude={"command", "feedback"}) | {
        "reached": int(trial.reached),
        "stages": "; ".join(trial.stages),
        "undesired": len(trial.undesired),
        "undesired_what": "; ".join(f"{t.name} {t.peak:.0f} N" for t in trial.undesired),
    }
    for name, link in (("command", trial.command), ("feedback", trial.feedback)):
        for part in ("asked_mean", "asked_p99", "mean", "p99"):
            seconds: float | None = getattr(link, part)
            row[f"{name}_{part}_ms"] = None if seconds is None else 1e3 * seconds
        row |= {f"{name}_used": link.used, f"{name}_lost": link.lost}
    return {_WITH_UNIT.get(name, name): value for name, value in row.items()}


def _flatten(row: Mapping[str, Any], prefix: str = "") -> dict[str, object]:
    """Make nested values columns, round numbers, and leave unknown values empty."""
    flat: dict[str, object] = {}
    for name, value in row.items():
        if isinstance(value, Mapping):
            flat |= _flatten(value, f"{prefix}{name}_")
        elif isinstance(value, float):
            flat[prefix + name] = float(f"{value:.6g}")
        else:
            flat[prefix + name] = "" if value is None else value
    return flat
