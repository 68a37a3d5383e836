"""Draws success beside the paper's, and how it grows with the number of demonstrations."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lab.learning.evaluation.comparison import Column, tasks_of
from lab.learning.evaluation.summary import Row
from lab.review.figure import DPI, GRID_COLOUR, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = ("#c08a2b", "#3f8f5f", "#2b6cb0", "#b5473c", "#6b4fa0", "#2a9d9d", "#a0527e", "#5b4636")
_MARKERS = "osD^vP"
_GROUP, _WIDEST = 0.8, 0.2
"""Parts of the distance between two tasks: of all bars of a task at most, and of one."""


def draw_success(path: Path, title: str, columns: Sequence[Column]) -> bool:
    """Draw success as bars, a group for each task, and the paper's success as marks on them.

    Args:
        path: the PNG file.
        title: of the figure.
        columns: policies that are drawn.

    Returns:
        whether there was one to draw.

    Raises:
        ConfigError: matplotlib is not installed.
    """
    # A policy has the same colour whether the others were evaluated or not.
    drawn = [(colour, column) for colour, column in enumerate(columns) if column.rows]
    if not drawn:
        return False
    tasks = tasks_of(columns)
    figure = new_figure(max(640, 320 + 60 * len(tasks) * len(drawn)), 420)
    axes = figure.subplots()
    width = min(_WIDEST, _GROUP / len(drawn))
    for number, (colour, column) in enumerate(drawn):
        at = {t: i + width * (number - (len(drawn) - 1) / 2) for i, t in enumerate(tasks)}
        mine = list(column.rows.values())
        places = [at[row.task] for row in mine]
        axes.bar(
            places, [100 * row.success.share for row in mine], 0.9 * width,
            color=_COLOURS[colour % len(_COLOURS)], label=column.head,
        )  # fmt: skip
        axes.errorbar(places, **_shares(mine), fmt="none", ecolor="#333333", capsize=3)
        said = [task for task in column.rows if task in column.paper]
        axes.plot(
            [at[task] for task in said], [column.paper[task].success for task in said],
            linestyle="none", marker="D", color="white", markeredgecolor="black", markersize=7,
            clip_on=False, label="paper" if said else "_",
        )  # fmt: skip
    axes.set_title(title, fontsize=11)
    axes.set_xticks(range(len(tasks)), tasks)
    axes.set_xlim(-0.6, len(tasks) - 0.4)
    axes.set_ylabel("success [%], 95 % (Wilson)")
    axes.set_ylim(0.0, 104.0)
    axes.grid(axis="y", color=GRID_COLOUR, linewidth=0.7)
    _finish(figure, path)
    return True


def draw_sizes(path: Path, rows: Sequence[Row]) -> bool:
    """Draw success over the size of the data set: a panel for each task, a line for each policy.

    Args:
        path: the PNG file.
        rows: of all policies; those with several sizes are drawn.

    Returns:
        whether there was one to draw.

    Raises:
        ConfigError: matplotlib is not installed.
    """
    sizes: dict[tuple[str, str, str], set[int]] = {}
    for row in rows:
        sizes.setdefault((row.label, row.task, row.link), set()).add(row.episodes or 0)
    drawn = [row for row in rows if row.episodes and len(sizes[row.label, row.task, row.link]) > 1]
    if not drawn:
        return False
    tasks = list(dict.fromkeys(row.task for row in drawn))
    lines = list(dict.fromkeys((row.label, row.link) for row in drawn))
    # Side by side, so that no interval hides another.
    gap = 0.012 * max(row.episodes or 0 for row in drawn)
    figure = new_figure(320 + 330 * len(tasks), 400)
    panels = figure.subplots(1, len(tasks), squeeze=False, sharey=True)[0]
    for axes, task in zip(panels, tasks, strict=True):
        for number, line in enumerate(lines):
            mine = [row for row in drawn if (row.task, row.label, row.link) == (task, *line)]
            mine.sort(key=lambda row: row.episodes or 0)
            axes.errorbar(
                [(row.episodes or 0) + gap * (number - (len(lines) - 1) / 2) for row in mine],
                **_shares(mine),
                color=_COLOURS[number % len(_COLOURS)],
                marker=_MARKERS[number % len(_MARKERS)],
                capsize=3,
                label=line[0] if line[1] == "none" else f"{line[0]}; {line[1]}",
            )
        axes.set_title(task, fontsize=11)
        axes.set_xlabel("demonstrations")
        axes.set_xlim(left=0.0)
        axes.set_ylim(-4.0, 104.0)
        axes.grid(color=GRID_COLOUR, linewidth=0.7)
    panels[0].set_ylabel("success [%], 95 % (Wilson)")
    _finish(figure, path)
    return True


def _shares(rows: Sequence[Row]) -> dict[str, Any]:
    """Return success as points with intervals, in percent, as matplotlib takes them."""
    found = [row.success for row in rows]
    low = [100 * (share.share - share.low) for share in found]
    high = [100 * (share.high - share.share) for share in found]
    return {"y": [100 * share.share for share in found], "yerr": [low, high]}


def _finish(figure: "Figure", path: Path) -> None:
    """Add one legend for all panels, and write the file."""
    handles: dict[str, Any] = {}
    for axes in figure.axes:
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
        drawn, labels = axes.get_legend_handles_labels()
        handles |= dict(zip(labels, drawn, strict=True))
    figure.legend(
        list(handles.values()), list(handles), loc="outside lower center", ncols=3, fontsize=8,
        frameon=False,
    )  # fmt: skip
    figure.savefig(path, dpi=1.5 * DPI)
