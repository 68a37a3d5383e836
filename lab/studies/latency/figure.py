"""Draws the study: completion times, success, and the workload if there are answer sheets."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

import numpy as np

from lab.review.figure import DPI, GRID_COLOUR, new_figure
from lab.studies.latency.plan import Plan
from lab.studies.latency.record import StudyTrial
from lab.studies.latency.stats import CellSummary
from lab.studies.latency.tlx import SCALES, AnswerSheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_CONDITION_COLOURS = ("#8a8f98", "#2b6cb0", "#2a9d9d", "#6b4fa0", "#a0527e", "#5b4636")
"""None is the colour of a verdict."""
_VERDICTS = {"success": ("o", "#3f8f5f"), "partial": ("D", "#e6c15a"), "failure": ("X", "#b5473c")}
"""Marker and colour of each verdict."""
_RED = _VERDICTS["failure"][1]
_HATCHES = {"synthetic": "", "human": "///"}
_SCALE_COLOURS = ("#4c72b0", "#937860", "#ccb974", "#55a868", "#8172b3", "#c44e52")
_SCALE_WIDTH = 0.12
"""Width of a bar of the workload; the unit is the distance of two conditions."""


def draw(
    path: Path,
    plan: Plan,
    trials: Sequence[StudyTrial],
    cells: Sequence[CellSummary],
    sheets: Sequence[AnswerSheet] = (),
) -> None:
    """Write the figure: a column of panels for each task, with the conditions side by side.

    Args:
        path: the PNG file.
        plan: plan of the study.
        trials: trials of all operators; there must be a trial or a sheet.
        cells: summary of the trials.
        sheets: answer sheets of persons; if there are any, each task gets a panel of workload.

    Raises:
        ConfigError: matplotlib is not installed.
    """
    known = {trial.task for trial in trials} | {sheet.task for sheet in sheets}
    tasks = [task for task in plan.tasks if task in known]
    operators = [name for name in _HATCHES if any(trial.operator == name for trial in trials)]
    shifts = (
        {"synthetic": -0.2, "human": 0.2} if len(operators) > 1 else dict.fromkeys(operators, 0)
    )
    heights = [3.0, 1.15, 1.9] if sheets else [3.0, 1.15]
    width, height = 1.2 + 4.6 * max(1.4, len(tasks)), 2.2 + 1.1 * sum(heights)
    figure = new_figure(round(width * DPI), round(height * DPI))
    panels = figure.subplots(
        len(heights), len(tasks), squeeze=False, sharex=True, height_ratios=heights
    )
    for column, task in zip(panels.T, tasks, strict=True):
        column[0].set_title(task, fontsize=11)
        _draw_times(column[0], plan, [trial for trial in trials if trial.task == task], shifts)
        _draw_shares(column[1], plan, [cell for cell in cells if cell.task == task], shifts)
        if sheets:
            _draw_workload(column[2], plan, [sheet for sheet in sheets if sheet.task == task])
        for axes in column:
            axes.grid(axis="y", color=GRID_COLOUR, linewidth=0.7)
            axes.set_axisbelow(True)
            axes.spines[["top", "right"]].set_visible(False)
        titles = [condition.title for condition in plan.conditions]
        column[-1].set_xticks(range(len(titles)), titles, fontsize=9)
        column[-1].set_xlim(-0.6, len(titles) - 0.4)
    labels = ("completion time [s]", "trials [%]", "workload of persons\n(NASA-TLX, 0 to 100)")
    for axes, label in zip(panels[:, 0], labels, strict=False):
        axes.set_ylabel(label)
    figure.suptitle(_title(trials, sheets), fontsize=12)
    legend = _legend(panels.flat)
    figure.legend(
        legend.values(), legend.keys(), loc="outside lower center", ncols=5, fontsize=8,
        frameon=False,
    )  # fmt: skip
    figure.savefig(path, dpi=1.5 * DPI)


def _title(trials: Sequence[StudyTrial], sheets: Sequence[AnswerSheet]) -> str:
    persons = {trial.participant for trial in trials if trial.operator == "human"}
    persons |= {sheet.participant for sheet in sheets}
    cells = Counter((t.task, t.condition) for t in trials if t.operator == "synthetic")
    parts = []
    if cells:
        counts = sorted({min(cells.values()), max(cells.values())})
        number = " to ".join(map(str, counts))
        parts.append(f"synthetic operator, {number} trials each, simulated time")
    if persons:
        parts.append(f"{len(persons)} human participant{'s' if len(persons) > 1 else ''}")
    return "Teleoperation under latency\n" + "; ".join(parts)


def _draw_times(
    axes: "Axes", plan: Plan, trials: Sequence[StudyTrial], shifts: Mapping[str, float]
) -> None:
    """Draw boxes over the trials that reached the goal, and a marker for every trial."""
    rng = np.random.default_rng(0)
    for (index, condition), operator in product(enumerate(plan.conditions), shifts):
        mine = [t for t in trials if (t.condition, t.operator) == (condition.name, operator)]
        at = index + shifts[operator]
        colour = _CONDITION_COLOURS[index % len(_CONDITION_COLOURS)]
        # Whiskers reach to the ends: every trial has a marker, and none is an outlier.
        axes.boxplot(
            [[trial.time for trial in mine if trial.reached]], positions=[at], widths=0.3,
            whis=(0, 100), showfliers=False, patch_artist=True, manage_ticks=False,
            medianprops={"color": "black", "linewidth": 1.6},
            boxprops={"facecolor": colour, "alpha": 0.35, "hatch": _HATCHES[operator]},
            label=f"{operator} operator",
        )  # fmt: skip
        for verdict, (marker, special) in _VERDICTS.items():
            kinds = {verdict, "error"} if verdict == "failure" else {verdict}
            times = [trial.charged for trial in mine if trial.verdict in kinds]
            success = verdict == "success"
            axes.scatter(
                at + rng.uniform(-0.11, 0.11, len(times)), times, marker=marker, zorder=3,
                s=20 if success else 42, color=colour if success else special, clip_on=False,
                edgecolors="white" if success else "black", linewidths=0.5,
                label=f"trial: {verdict}",
            )  # fmt: skip
    if any(not trial.reached for trial in trials):
        limit = max(trial.limit for trial in trials)
        axes.axhline(limit, color=_RED, linewidth=0.8, linestyle=":")
        axes.annotate(
            f"time limit {limit:g} s: goal not reached",
            (0.01, limit), xycoords=("axes fraction", "data"), xytext=(0, 7),
            textcoords="offset points", fontsize=8, color=_RED,
        )  # fmt: skip
    axes.set_ylim(0.0, 1.1 * max((trial.charged for trial in trials), default=1.0))


def _draw_shares(
    axes: "Axes", plan: Plan, cells: Sequence[CellSummary], shifts: Mapping[str, float]
) -> None:
    """Draw the shares of the verdicts as stacked bars, with the interval of the successes."""
    order = [condition.name for condition in plan.conditions]
    for cell in cells:
        at, bottom = order.index(cell.condition) + shifts[cell.operator], 0.0
        shares = (cell.success.share, cell.partial, cell.failure)
        for share, (verdict, (_, colour)) in zip(shares, _VERDICTS.items(), strict=True):
            axes.bar(
                at, 100 * share, 0.34, bottom=bottom, color=colour, edgecolor="white",
                hatch=_HATCHES[cell.operator], label=f"share: {verdict}",
            )  # fmt: skip
            bottom += 100 * share
        axes.vlines(
            at, 100 * cell.success.low, 100 * cell.success.high, "black", linewidth=1.2,
            label="success, 95 % (Wilson)",
        )  # fmt: skip
        axes.annotate(
            f"{100 * cell.success.share:.0f} %", (at, 100.0), xytext=(0, 3), ha="center",
            textcoords="offset points", fontsize=8,
        )  # fmt: skip
    axes.set_ylim(0.0, 118.0)
    axes.set_yticks([0, 50, 100])


def _draw_workload(axes: "Axes", plan: Plan, sheets: Sequence[AnswerSheet]) -> None:
    """Draw the mean of each scale as a bar, raw scores as points, and their mean as a line."""
    for at, condition in enumerate(plan.conditions):
        mine = [sheet for sheet in sheets if sheet.condition == condition.name]
        if not mine:
            continue
        for index, ((scale, text), colour) in enumerate(
            zip(SCALES.items(), _SCALE_COLOURS, strict=True)
        ):
            axes.bar(
                at + (index - 2.5) * _SCALE_WIDTH, fmean(sheet.ratings[scale] for sheet in mine),
                _SCALE_WIDTH, color=colour, alpha=0.8, label=text.title,
            )  # fmt: skip
        scores = [sheet.raw_score for sheet in mine]
        axes.hlines(
            fmean(scores), at - 3 * _SCALE_WIDTH, at + 3 * _SCALE_WIDTH, "black", linewidth=1.4,
            label="raw score, mean",
        )  # fmt: skip
        axes.plot(
            [at] * len(scores), scores, "o", ms=4, mfc="white", mec="black", clip_on=False,
            label="raw score of a sheet",
        )  # fmt: skip
    axes.set_ylim(0.0, 100.0)


def _legend(panels: Iterable["Axes"]) -> dict[str, Any]:
    """Return the first artist of each label."""
    found: dict[str, Any] = {}
    for axes in panels:
        for artist, label in zip(*axes.get_legend_handles_labels(), strict=True):
            found.setdefault(label, artist)
    return found
