"""Formats the report of a study as tables for the terminal."""

from collections.abc import Sequence
from itertools import groupby

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from lab.studies.latency.criteria import Comparison
from lab.studies.latency.plan import Plan
from lab.studies.latency.report import Report
from lab.studies.latency.stats import CellSummary
from lab.studies.latency.tlx import SCALES, Workload

SUMMARY_LEGEND = (
    "Times of trials that reached the goal. Δ: mean difference to that condition over all trials "
    "with the same start, those that did not reach the goal with the time limit. Arms: root mean "
    "square of joint accelerations. Latency: requested, then measured mean/p99 from sending a "
    "message to the step that acted on it."
)


def report_text(report: Report) -> RenderableType:
    """Return all tables of a report with their legends and the conclusion."""
    plan = report.plan
    parts = [summary_table(plan, report.cells), Text(SUMMARY_LEGEND, "dim"), ""]
    if report.workload:
        parts += [workload_table(plan, report.workload), ""]
    conclusion = {True: "reproduced", False: "NOT reproduced", None: "undecided (too few trials)"}
    parts += [
        criteria_table(plan, report.comparisons),
        Text(report.criteria, "dim"),
        Text(
            "The shape of the paper's result, with the synthetic operator: "
            f"{conclusion[report.reproduced]}",
            "bold",
        ),
    ]
    return Group(*parts)


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
                cell.command.text,
                cell.feedback.text,
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
    """Return the comparisons: a row for each criterion, task and pair of conditions."""
    table = _table(["criterion", "task", "comparison"], ["pairs", "Δ s [95 %]", "expected", "met"])
    results = {True: ("yes", "green"), False: ("NO", "red"), None: ("?", "yellow")}
    for one in comparisons:
        sign = ">" if one.criterion == "latency" else "<"
        table.add_row(
            one.criterion,
            one.task,
            f"{plan.condition(one.condition).title} against {plan.condition(one.reference).title}",
            str(one.difference.count),
            one.difference.text("+.2f"),
            f"{sign} {one.bound:.2f}",
            Text(*results[one.met]),
        )
    return table


def _table(left: Sequence[str], right: Sequence[str]) -> Table:
    table = Table(pad_edge=False, show_edge=False, header_style="bold")
    # In a narrow terminal cells are folded, so that no figure is cut off.
    for name in left:
        table.add_column(name, overflow="fold")
    for name in right:
        table.add_column(escape(name), justify="right", overflow="fold")
    return table
