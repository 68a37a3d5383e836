"""Writes the study as CSV and JSON, and formats it as tables."""

import csv
import io
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from itertools import groupby
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from common.files import write_whole
from lab.studies.latency.criteria import CRITERIA, Comparison, reproduced
from lab.studies.latency.plan import Plan
from lab.studies.latency.record import StudyTrial
from lab.studies.latency.stats import CellSummary
from lab.studies.latency.tlx import SCALES, Workload

_WITH_UNIT = {
    "time": "time_s",
    "limit": "limit_s",
    "hand_path": "hand_path_m",
    "arm_acceleration": "arm_acceleration_rad_s2",
    "simulated": "simulated_s",
    "wall": "wall_s",
}
"""Columns of ``trials.csv`` that have a unit."""


def write_trials(path: Path, trials: Sequence[StudyTrial]) -> None:
    """Write a row for each trial; durations in seconds, latencies in milliseconds."""
    write_csv(path, map(_trial_row, trials))


def write_csv(path: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write rows with the same keys, whole or not at all; nested values become columns."""
    text, flat = io.StringIO(), [_flatten(row) for row in rows]
    if flat:
        writer = csv.DictWriter(text, list(flat[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(flat)
    write_whole(path, text.getvalue().encode())


def write_summary(
    root: Path,
    plan: Plan,
    cells: Sequence[CellSummary],
    comparisons: Sequence[Comparison],
    workload: Sequence[Workload],
) -> None:
    """Write ``summary.csv`` and ``summary.json``."""
    write_csv(root / "summary.csv", map(asdict, cells))
    content = {
        "plan": plan.model_dump(mode="json"),
        "baseline": plan.baseline.name,
        "cells": [asdict(cell) for cell in cells],
        "criteria": CRITERIA,
        "comparisons": [asdict(comparison) for comparison in comparisons],
        "reproduced": reproduced(comparisons),
        "workload": [part.model_dump(mode="json") for part in workload],
    }
    text = json.dumps(content, indent=1, allow_nan=False) + "\n"
    write_whole(root / "summary.json", text.encode())


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


SUMMARY_LEGEND = (
    "Times of trials that reached the goal. Δ: mean difference to that condition over all trials "
    "with the same start, those that did not reach the goal with the time limit. Arms: root mean "
    "square of joint accelerations. Latency: requested, then measured mean/p99 from sending a "
    "message to the step that acted on it."
)


def summary_table(plan: Plan, cells: Sequence[CellSummary]) -> RenderableType:
    """Return the summary, a row for each condition of each task."""
    table = _table(
        ["operator", "task", "condition"],
        ["n", "success % [95 %]", "partial %", "median s [quartiles]", "mean s [95 %]",
         f"Δ {plan.baseline.name} s [95 %]", "arms rad/s²", "command ms", "feedback ms"],
    )  # fmt: skip
    for (operator, task), group in groupby(cells, key=lambda cell: (cell.operator, cell.task)):
        for cell in group:
            done, median, arms = cell.success, "none", "?"
            if cell.time_median is not None:
                median = f"{cell.time_median:.1f} [{cell.time_q1:.1f}, {cell.time_q3:.1f}]"
            if cell.arm_acceleration is not None:
                arms = f"{cell.arm_acceleration:.1f}"
            table.add_row(
                operator,
                task,
                plan.condition(cell.condition).title,
                str(cell.trials),
                f"{100 * done.share:.0f} [{100 * done.low:.0f}, {100 * done.high:.0f}]",
                f"{100 * cell.partial:.0f}",
                median,
                cell.time.text(".1f"),
                cell.difference.text("+.2f") if cell.difference.count else "",
                arms,
                cell.command.text(),
                cell.feedback.text(),
            )
        table.add_section()
    return table


def workload_table(plan: Plan, workload: Sequence[Workload]) -> RenderableType:
    """Return the NASA-TLX of persons, a row for each condition of each task."""
    table = _table(["human", "condition"], ["sheets", "persons", *SCALES, "raw", "weighted"])
    for part in workload:
        table.add_row(
            part.task,
            plan.condition(part.condition).title,
            str(part.sheets),
            str(part.participants),
            *(f"{part.scales[scale]:.0f}" for scale in SCALES),
            f"{part.raw:.1f}",
            "" if part.weighted is None else f"{part.weighted:.1f} (of {part.weighted_sheets})",
        )
    return table


def criteria_table(plan: Plan, comparisons: Sequence[Comparison]) -> RenderableType:
    """Return the comparisons with their results, the criteria, and the conclusion."""
    table = _table(["criterion", "task", "comparison"], ["pairs", "Δ s [95 %]", "expected", "met"])
    for one in comparisons:
        sign = ">" if one.criterion == "latency" else "<"
        met, style = {True: ("yes", "green"), False: ("NO", "red"), None: ("?", "yellow")}[one.met]
        table.add_row(
            one.criterion,
            one.task,
            f"{plan.condition(one.condition).title} against {plan.condition(one.reference).title}",
            str(one.difference.count),
            one.difference.text("+.2f"),
            f"{sign} {one.bound:.2f}",
            Text(met, style),
        )
    conclusion = {True: "reproduced", False: "NOT reproduced", None: "undecided (too few trials)"}
    return Group(
        table,
        Text(CRITERIA, style="dim"),
        Text(
            "The shape of the paper's result, with the synthetic operator: "
            f"{conclusion[reproduced(comparisons)]}",
            style="bold",
        ),
    )


def _table(left: Sequence[str], right: Sequence[str]) -> Table:
    table = Table(pad_edge=False, show_edge=False, header_style="bold")
    # In a narrow terminal cells are folded, so that no figure is cut off.
    for name in left:
        table.add_column(name, overflow="fold")
    for name in right:
        table.add_column(escape(name), justify="right", overflow="fold")
    return table
