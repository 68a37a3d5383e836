"""Draws how success grows with the number of demonstrations."""

from collections.abc import Collection, Sequence
from pathlib import Path

from lab.learning.evaluation.summary import Row
from lab.review.figure import DPI, GRID_COLOUR, new_figure

_COLOURS = ("#2b6cb0", "#b5473c", "#3f8f5f", "#6b4fa0", "#c08a2b", "#2a9d9d", "#a0527e", "#5b4636")
_MARKERS = "osD^vP"


def draw_sizes(path: Path, rows: Sequence[Row], labels: Collection[str]) -> bool:
    """Draw success over the size of the data set: a panel for each task, a line for each policy.

    Args:
        path: the PNG file.
        rows: of all policies; those without an injected delay of their own count.
        labels: of the policies that are drawn.

    Returns:
        whether there was one to draw.

    Raises:
        ConfigError: matplotlib is not installed.
    """
    drawn = [row for row in rows if row.label in labels and row.episodes]
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
            shares = [row.success for row in mine]
            axes.errorbar(
                [(row.episodes or 0) + gap * (number - (len(lines) - 1) / 2) for row in mine],
                [100 * share.share for share in shares],
                yerr=[
                    [100 * (share.share - share.low) for share in shares],
                    [100 * (share.high - share.share) for share in shares],
                ],
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
        axes.set_axisbelow(True)
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("success [%], 95 % (Wilson)")
    handles = {
        label: handle
        for axes in panels
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.legend(
        handles.values(), handles.keys(), loc="outside lower center", ncols=2, fontsize=8,
        frameon=False,
    )  # fmt: skip
    figure.savefig(path, dpi=1.5 * DPI)
    return True
