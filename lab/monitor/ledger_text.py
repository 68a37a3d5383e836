"""Format the latency breakdown, for the live table and for logs alike."""

from collections.abc import Iterable
from math import isnan

from rich.table import Table
from rich.text import Text

from common.journal.stages import STAGES
from common.schemas import StageTime

LEGEND = "median/p99 in ms; use: from the step's start to its results sent, decode is part of it"


def short_ms(seconds: float) -> str:
    """Format a time as milliseconds in four characters: ``.04``, ``4.2``, ``42``, ``13k``.

    NaN, an unknown time, is ``-``.
    """
    ms = 1e3 * seconds
    size = abs(ms)
    if isnan(size):
        return "-"
    if size < 0.995:
        text = f"{ms:.2f}".replace("0.", ".", 1)
        return "0" if text in {".00", "-.00"} else text
    if size < 9.95:
        return f"{ms:.1f}"
    return f"{ms:.0f}" if size < 9999.5 else f"{ms / 1e3:.0f}k"


def stage_cells(stages: Iterable[StageTime]) -> list[str]:
    """Format one cell per stage of :data:`common.journal.ledger.STAGES`; ``-`` if unknown."""
    known = {stage.stage: stage for stage in stages}
    return [
        f"{short_ms(known[name].median)}/{short_ms(known[name].p99)}" if name in known else "-"
        for name in STAGES
    ]


def add_stages(table: Table) -> None:
    """Add one column per stage."""
    for name in STAGES:
        table.add_column(name, justify="right", no_wrap=True)


def styled(cells: list[str]) -> list[Text]:
    """Print the total in bold, and dim the stages that took next to no time."""
    return [
        Text(cell, style="bold" if name == "total" else "dim" if cell in {"0/0", "-"} else "")
        for name, cell in zip(STAGES, cells, strict=True)
    ]


def plain_table() -> Table:
    """Return a table without rules, so that several fit a small terminal."""
    return Table(box=None, pad_edge=False, header_style="bold underline", collapse_padding=True)
