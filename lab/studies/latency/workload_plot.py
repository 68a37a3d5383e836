"""The workload of answer sheets as panels of the study's figure."""

from collections.abc import Sequence
from typing import Any

from lab.studies.latency.plan import Plan
from lab.studies.latency.tlx import SCALES, AnswerSheet

_COLOURS = ("#4c72b0", "#937860", "#ccb974", "#55a868", "#8172b3", "#c44e52")
_WIDTH = 0.12


def draw_workload(axes: Any, plan: Plan, sheets: Sequence[AnswerSheet]) -> None:
    """Mean of each scale as bars, each sheet's raw score as a point, their mean as a line.

    Args:
        axes: to draw on.
        plan: of the study, for the conditions' order.
        sheets: of one task.
    """
    for at, condition in enumerate(plan.conditions):
        mine = [sheet for sheet in sheets if sheet.condition == condition.name]
        if not mine:
            continue
        for place, (scale, colour) in enumerate(zip(SCALES, _COLOURS, strict=True)):
            mean = sum(sheet.ratings.of(scale) for sheet in mine) / len(mine)
            axes.bar(at + (place - 2.5) * _WIDTH, mean, _WIDTH, color=colour, alpha=0.8)
        scores = [sheet.raw_score for sheet in mine]
        mean = sum(scores) / len(scores)
        axes.plot([at - 3 * _WIDTH, at + 3 * _WIDTH], [mean, mean], color="black", linewidth=1.4)
        axes.plot(
            [at] * len(scores), scores, "o", markersize=4, markerfacecolor="white",
            markeredgecolor="black", clip_on=False, zorder=3,
        )  # fmt: skip
    axes.set_ylim(0.0, 100.0)


def workload_legend() -> list[Any]:
    """Handles for the figure's legend."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    scales = [
        Patch(color=colour, alpha=0.8, label=text.title)
        for text, colour in zip(SCALES.values(), _COLOURS, strict=True)
    ]
    sheet = Line2D(
        [], [], marker="o", color="black", linewidth=1.4, markerfacecolor="white",
        markersize=4, label="raw score: sheets, mean",
    )  # fmt: skip
    return [*scales, sheet]
