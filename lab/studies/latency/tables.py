"""The study as CSV, JSON and text."""

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from common.files import write_whole
from lab.studies.latency.finding import CRITERIA, Check, Finding
from lab.studies.latency.plan import Plan
from lab.studies.latency.row import LinkTake, TrialRow
from lab.studies.latency.stats import CellSummary, Interval
from lab.studies.latency.tlx import SCALES, Workload

_LINK = ("asked_mean", "asked_p99", "mean", "p99")


def write_trials(path: Path, rows: Sequence[TrialRow]) -> None:
    """One row a trial; durations in seconds, latencies in milliseconds."""
    write_csv(path, [_flat(row) for row in rows])


def write_csv(path: Path, rows: Sequence[dict[str, object]]) -> None:
    """Write rows that have the same keys, whole or not at all."""
    text = io.StringIO()
    if rows:
        writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows([{k: _rounded(v) for k, v in row.items()} for row in rows])
    write_whole(path, text.getvalue().encode())


def write_summary(
    root: Path,
    plan: Plan,
    cells: Sequence[CellSummary],
    finding: Finding,
    workload: Sequence[Workload],
) -> None:
    """``summary.csv`` and ``summary.json``."""
    write_csv(root / "summary.csv", [cell.flat() for cell in cells])
    content = {
        "plan": plan.model_dump(mode="json"),
        "baseline": plan.baseline.name,
        "cells": [asdict(cell) for cell in cells],
        "criteria": CRITERIA,
        "finding": asdict(finding),
        "workload": [part.model_dump(mode="json") for part in workload],
    }
    text = json.dumps(content, indent=1, allow_nan=False) + "\n"
    write_whole(root / "summary.json", text.encode())


def write_workload(path: Path, workload: Sequence[Workload]) -> None:
    """One row a condition of a task."""
    write_csv(
        path, [part.model_dump(exclude={"scales"}) | dict(part.scales.items()) for part in workload]
    )


def workload_table(plan: Plan, workload: Sequence[Workload]) -> RenderableType:
    """A row a condition of a task: persons' NASA-TLX."""
    table = Table(pad_edge=False, show_edge=False, header_style="bold")
    for name in ("human", "condition"):
        table.add_column(name, overflow="fold")
    for name in ("sheets", "persons", *SCALES, "raw", "weighted"):
        table.add_column(name, justify="right", overflow="fold")
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


def summary_table(plan: Plan, cells: Sequence[CellSummary]) -> RenderableType:
    """A row a cell."""
    table = Table(pad_edge=False, show_edge=False, header_style="bold")
    # In a narrow terminal figures are folded, never cut.
    for name in ("operator", "task", "condition"):
        table.add_column(name, overflow="fold")
    for name in (
        "n", "success % [95 %]", "partial %", "median s [quartiles]", "mean s [95 %]",
        f"Δ {plan.baseline.name} s [95 %]", "arms rad/s²", "command ms", "feedback ms",
    ):  # fmt: skip
        table.add_column(escape(name), justify="right", overflow="fold")
    last = ("", "")
    for cell in cells:
        here = (cell.operator, cell.task)
        if here != last and last[0]:
            table.add_section()
        last = here
        table.add_row(
            cell.operator, cell.task, plan.condition(cell.condition).title, *_cells_text(cell)
        )
    return table


LEGEND = (
    "Times of trials that reached the goal. Δ: mean difference to that condition over all trials "
    "with the same start, those that did not reach the goal with the time limit. Arms: root mean "
    "square of joint accelerations. Latency: asked for, then measured mean/p99 from sending a "
    "message to the step that acted on it."
)


def closing(finding: Finding) -> RenderableType:
    """The checks, the criteria and the conclusion."""
    lines = [_check(check) for check in (*finding.latency, *finding.interpolation)]
    return Group(*lines, Text(CRITERIA, style="dim"), Text(finding.sentence, style="bold"))


def _check(check: Check) -> Text:
    mark, style = {True: ("yes", "green"), False: ("NO", "red"), None: ("?", "yellow")}[check.held]
    return Text.assemble((f"{mark:>3}", style), f"  {check.task}: {check.text}")


def _cells_text(cell: CellSummary) -> list[str]:
    low, high = cell.success_interval
    found = cell.difference
    return [
        str(cell.trials),
        f"{100 * cell.success:.0f} [{100 * low:.0f}, {100 * high:.0f}]",
        f"{100 * cell.partial:.0f}",
        "none" if cell.time_median is None
        else f"{cell.time_median:.1f} [{cell.time_q1:.1f}, {cell.time_q3:.1f}]",
        "none" if cell.time_mean is None
        else f"{cell.time_mean:.1f}{_interval(cell.time_interval, '.1f')}",
        "" if found is None else f"{found.mean:+.2f}{_interval(found.interval, '+.2f')}",
        "?" if cell.arm_acceleration is None else f"{cell.arm_acceleration:.1f}",
        _latency(cell.command_asked, cell.command, cell.command_p99),
        _latency(cell.feedback_asked, cell.feedback, cell.feedback_p99),
    ]  # fmt: skip


def _interval(interval: Interval | None, form: str) -> str:
    return "" if interval is None else f" [{interval[0]:{form}}, {interval[1]:{form}}]"


def _latency(asked: float, mean: float | None, p99: float | None) -> str:
    got = "?" if mean is None or p99 is None else f"{1e3 * mean:.0f}/{1e3 * p99:.0f}"
    return f"{1e3 * asked:.0f}: {got}"


def _flat(row: TrialRow) -> dict[str, object]:
    flat: dict[str, object] = {
        "operator": row.operator,
        "participant": row.participant,
        "task": row.task,
        "condition": row.condition,
        "seed": row.seed,
        "verdict": row.verdict,
        "reached": int(row.reached),
        "time_s": row.time,
        "limit_s": row.limit,
        "reason": row.reason,
        "gave_up": row.gave_up,
        "doing": row.doing,
        "stages": "; ".join(row.stages),
        "undesired": len(row.undesired),
        "undesired_what": "; ".join(f"{t.name} {t.peak:.0f} N" for t in row.undesired),
        "hand_path_m": row.hand_path,
        "arm_acceleration_rad_s2": row.arm_acceleration,
    }
    for name, take in (("command", row.command), ("feedback", row.feedback)):
        flat |= {f"{name}_{part}_ms": _milliseconds(take, part) for part in _LINK}
        flat |= {f"{name}_used": take.used, f"{name}_lost": take.lost}
    return flat | {"simulated_s": row.simulated, "wall_s": row.wall}


def _milliseconds(take: LinkTake, part: str) -> float | None:
    value: float | None = getattr(take, part)
    return None if value is None else 1e3 * value


def _rounded(value: object) -> object:
    if value is None:
        return ""
    return float(f"{value:.6g}") if isinstance(value, float) else value
