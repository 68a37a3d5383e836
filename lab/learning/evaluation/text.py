"""Formats the rows of an evaluation for the terminal."""

from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from lab.learning.evaluation.summary import Row
from lab.trials.estimates import Proportion
from lab.trials.spec import TrialResult, format_spread

LEGEND = (
    "Partial counts successes too. Intervals: 95 % (Wilson; of differences, bootstrap). Time: "
    "median (range) of the successes. Still: mean time of a trial in which the hands' set-points "
    "rest and the robot does not walk."
)
_COMPARED = " Δ: mean difference to the operator, of seeds in which both succeed."


def rows_text(rows: Sequence[Row]) -> RenderableType:
    """Return the table of rows, its legend, and all trials that were no success."""
    compared = any(row.difference.count for row in rows)
    table = Table(pad_edge=False, show_edge=False, header_style="bold")
    for name in ("policy", "task", "link"):
        table.add_column(name, overflow="fold")
    numbers = ["n", "success % [95 %]", "partial %", "time s", "still s", "falls", "speed"]
    for name in [*numbers, *(["Δ operator s [95 %]"] if compared else [])]:
        table.add_column(escape(name), justify="right", overflow="fold")
    for row in rows:
        cells = [row.label, row.task, row.link, str(len(row.results)), share_text(row.success)]
        cells += [share_text(row.partial), format_spread(row.times) or "none"]
        cells += ["?" if row.still is None else f"{row.still:.1f}", str(row.falls), _speed(row)]
        cells += [row.difference.text("+.1f")] if compared else []
        table.add_row(*map(escape, cells))
    failures = [failure_text(row, r) for row in rows for r in row.results if not _succeeded(r)]
    legend = LEGEND + (_COMPARED if compared else "")
    return Group(table, Text(legend, "dim"), *(Text(text) for text in failures))


def share_text(share: Proportion) -> str:
    """Format a share as ``92 [75, 98]``, in percent."""
    return f"{100 * share.share:.0f} [{100 * share.low:.0f}, {100 * share.high:.0f}]"


def failure_text(row: Row, result: TrialResult) -> str:
    """Format a trial that was no success in one line."""
    return f"{row.label}: {result_text(result)}"


def result_text(result: TrialResult) -> str:
    """Format a trial in one line, for the progress."""
    text = f"{result.task} seed {result.seed}: {result.verdict} at {result.time:.1f} s"
    if not _succeeded(result):
        text += f": {result.reason}"
        if result.still is not None:
            text += f"; stood still for {result.still:.1f} s"
        text += f" ({result.doing})" if result.doing else ""
    return text


def _succeeded(result: TrialResult) -> bool:
    return result.verdict == "success"


def _speed(row: Row) -> str:
    wall = sum(result.wall for result in row.results)
    return f"{sum(result.simulated for result in row.results) / max(wall, 1e-9):.1f} x"
