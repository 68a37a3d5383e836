"""The study as a figure: completion times, success, and the workload where there are sheets."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from common.errors import ConfigError
from lab.studies.latency.plan import Plan
from lab.studies.latency.row import Operator, TrialRow
from lab.studies.latency.stats import CellSummary
from lab.studies.latency.tlx import AnswerSheet
from lab.studies.latency.workload_plot import draw_workload, workload_legend

_COLOURS = ("#8a8f98", "#2b6cb0", "#2a9d9d", "#6b4fa0", "#a0527e", "#5b4636")
"""Of conditions; none is one of a verdict."""
_VERDICTS = (("success", "#3f8f5f"), ("partial", "#e6c15a"), ("failure", "#b5473c"))
_MARKS = {"success": "o", "partial": "D", "failure": "X", "error": "X"}
_OFFSET = {"synthetic": 0.0, "human": 0.4}
"""Where a human's box stands, beside that of the synthetic operator [conditions]."""


def pyplot() -> Any:
    """Matplotlib without a display.

    Raises:
        ConfigError: it is not installed.
    """
    try:
        import matplotlib as mpl
    except ModuleNotFoundError as error:
        raise ConfigError("the figure needs matplotlib: pip install 'trill[study]'") from error
    mpl.use("Agg")
    import matplotlib.pyplot as plt

    return plt


def draw(
    path: Path,
    plan: Plan,
    rows: Sequence[TrialRow],
    cells: Sequence[CellSummary],
    sheets: Sequence[AnswerSheet] = (),
) -> None:
    """Write the figure.

    Args:
        path: of the PNG.
        plan: of the study.
        rows: trials of every operator; at least one, or a sheet.
        cells: the same, summed up.
        sheets: of persons; with any there is a panel more a task.

    Raises:
        ConfigError: matplotlib is not installed.
    """
    plt = pyplot()
    known = {row.task for row in rows} | {sheet.task for sheet in sheets}
    tasks = [task for task in plan.tasks if task in known]
    heights = [3.0, 1.15, 1.9] if sheets else [3.0, 1.15]
    figure, axes = plt.subplots(
        len(heights),
        len(tasks),
        figsize=(1.2 + 4.6 * max(1.4, len(tasks)), 2.2 + 1.1 * sum(heights)),
        height_ratios=heights,
        squeeze=False,
        layout="constrained",
    )
    for column, task in enumerate(tasks):
        of_task = [row for row in rows if row.task == task]
        if of_task:
            _times(axes[0][column], plan, of_task)
            _success(axes[1][column], plan, [cell for cell in cells if cell.task == task])
        if sheets:
            draw_workload(axes[2][column], plan, [s for s in sheets if s.task == task])
        for number in range(len(heights)):
            _conditions(axes[number][column], plan, labels=number == len(heights) - 1)
        axes[0][column].set_title(task, fontsize=11)
    axes[0][0].set_ylabel("completion time [s]")
    axes[1][0].set_ylabel("trials [%]")
    if sheets:
        axes[2][0].set_ylabel("workload of persons\n(NASA-TLX, 0 to 100)")
    figure.suptitle(_title(rows, sheets), fontsize=12)
    handles = _legend({row.operator for row in rows}) + (workload_legend() if sheets else [])
    figure.legend(handles=handles, loc="outside lower center", ncols=5, fontsize=8, frameon=False)
    figure.savefig(path, dpi=150)
    plt.close(figure)


def _title(rows: Sequence[TrialRow], sheets: Sequence[AnswerSheet]) -> str:
    persons = {row.participant for row in rows if row.operator == "human"}
    persons |= {sheet.participant for sheet in sheets}
    cells = Counter((r.task, r.condition) for r in rows if r.operator == "synthetic")
    parts = []
    if cells:
        few, many = min(cells.values()), max(cells.values())
        number = f"{many}" if few == many else f"{few} to {many}"
        parts.append(f"synthetic operator, {number} trials each, simulated time")
    if persons:
        parts.append(f"{len(persons)} human participant{'s' if len(persons) > 1 else ''}")
    return "Teleoperation under latency\n" + "; ".join(parts)


def _times(axes: Any, plan: Plan, rows: Sequence[TrialRow]) -> None:
    """Boxes over the trials that reached the goal, and every trial as a mark."""
    limit = max(row.limit for row in rows)
    lost = any(not row.reached for row in rows)
    rng = np.random.default_rng(0)
    operators = [name for name in _OFFSET if any(row.operator == name for row in rows)]
    for at, condition in enumerate(plan.conditions):
        colour = _COLOURS[at % len(_COLOURS)]
        for operator in operators:
            mine = [r for r in rows if (r.condition, r.operator) == (condition.name, operator)]
            _box(axes, at + _shift(operator, operators), mine, colour, operator)
            _points(axes, at + _shift(operator, operators), mine, colour, rng)
    if lost:
        axes.axhline(limit, color="#b5473c", linewidth=0.8, linestyle=":")
        axes.annotate(
            f"time limit {limit:g} s: goal not reached",
            (0.01, limit), xycoords=("axes fraction", "data"), xytext=(0, 7),
            textcoords="offset points", fontsize=8, color="#b5473c",
        )  # fmt: skip
    axes.set_ylim(0.0, 1.1 * max([row.charged for row in rows]))


def _shift(operator: Operator | str, operators: Sequence[str]) -> float:
    return 0.0 if len(operators) == 1 else _OFFSET[operator] - 0.2


def _box(axes: Any, at: float, rows: Sequence[TrialRow], colour: str, operator: str) -> None:
    times = [row.time for row in rows if row.reached]
    if not times:
        return
    # Whiskers to the ends: every trial is drawn besides, and no point is called an outlier.
    parts = axes.boxplot(
        [times], positions=[at], widths=0.34 if operator == "synthetic" else 0.26, whis=(0, 100),
        showfliers=False, patch_artist=True, manage_ticks=False,
        medianprops={"color": "black", "linewidth": 1.6},
    )  # fmt: skip
    for box in parts["boxes"]:
        box.set(facecolor=colour, alpha=0.35, hatch="///" if operator == "human" else "")


def _points(
    axes: Any, at: float, rows: Sequence[TrialRow], colour: str, rng: np.random.Generator
) -> None:
    for row in rows:
        fine = row.verdict == "success"
        axes.plot(
            at + rng.uniform(-0.11, 0.11), row.charged, marker=_MARKS[row.verdict],
            markersize=4.5 if fine else 6.5, linestyle="none", zorder=3, clip_on=False,
            markerfacecolor=colour if fine else dict(_VERDICTS).get(row.verdict, "#b5473c"),
            markeredgecolor="white" if fine else "black", markeredgewidth=0.5,
        )  # fmt: skip


def _success(axes: Any, plan: Plan, cells: Sequence[CellSummary]) -> None:
    operators = [name for name in _OFFSET if any(cell.operator == name for cell in cells)]
    at_of = {condition.name: at for at, condition in enumerate(plan.conditions)}
    for cell in cells:
        at = at_of[cell.condition] + _shift(cell.operator, operators)
        bottom = 0.0
        for name, colour in _VERDICTS:
            share = 100.0 * getattr(cell, name)
            axes.bar(
                at, share, 0.34, bottom=bottom, color=colour, edgecolor="white",
                hatch="///" if cell.operator == "human" else "",
            )  # fmt: skip
            bottom += share
        low, high = (100.0 * bound for bound in cell.success_interval)
        axes.plot([at, at], [low, high], color="black", linewidth=1.2)
        axes.annotate(
            f"{100 * cell.success:.0f} %", (at, 100.0), xytext=(0, 3), ha="center",
            textcoords="offset points", fontsize=8,
        )  # fmt: skip
    axes.set_ylim(0.0, 118.0)
    axes.set_yticks([0, 50, 100])


def _conditions(axes: Any, plan: Plan, *, labels: bool) -> None:
    """The conditions along the axis."""
    titles = [condition.title for condition in plan.conditions]
    axes.set_xticks(range(len(titles)), titles if labels else [""] * len(titles), fontsize=9)
    axes.set_xlim(-0.6, len(titles) - 0.4)
    axes.grid(axis="y", color="#e4e4e0", linewidth=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def _legend(operators: set[Operator]) -> list[Any]:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    colours = dict(_VERDICTS)
    handles: list[Any] = [
        Line2D([], [], marker="o", color="#777777", linestyle="none", label="trial: success"),
        *(
            Line2D([], [], marker=_MARKS[name], color=colours[name], linestyle="none",
                   label=f"trial: {name}", markeredgecolor="black", markeredgewidth=0.5)
            for name in ("partial", "failure")
        ),
        *(Patch(color=colour, label=f"share: {name}") for name, colour in _VERDICTS),
        Line2D([], [], color="black", linewidth=1.2, label="success, 95 % (Wilson)"),
    ]  # fmt: skip
    if len(operators) > 1:
        for label, hatch in (("synthetic operator", ""), ("human operator", "///")):
            handles.append(Patch(facecolor="#dddddd", edgecolor="black", hatch=hatch, label=label))
    return handles
