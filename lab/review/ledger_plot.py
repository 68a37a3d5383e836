"""Plot the latency of every stage of every input as box plots."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from common.journal.ledger import LedgerRow
from common.journal.stages import STAGES
from lab.review.figure import GRID_COLOUR, figure_image, new_figure
from lab.review.frames import write_picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLUMNS = 2
_PANEL = (760, 210)
"""Width and height of the panel of one input [pixels]."""
_HEADING = 70
"""Height of the title and the legend [pixels]."""
_STAGE_COLOUR, _TOTAL_COLOUR, _WHISKER_COLOUR = "#4c85b2", "#d66030", "#a0bed6"
_SHORTEST, _LONGEST = 0.01, 1e4
"""Times beyond these [ms] are drawn at the ends of the axis."""


def write_plot(path: Path, rows: Sequence[LedgerRow], title: str) -> None:
    """Write a PNG with one panel per input that was used and one box plot per stage.

    The whiskers reach from the 1st to the 99th percentile, the box covers the middle half and
    the line in it is the median.

    Raises:
        ConfigError: Matplotlib is not installed.
        LabError: the file cannot be written.
    """
    used = [row for row in rows if row.applied]
    lines = max(1, -(-len(used) // _COLUMNS))
    figure = new_figure(_COLUMNS * _PANEL[0], _HEADING + lines * _PANEL[1])
    figure.suptitle(
        f"{title}\nwhiskers: 1st to 99th percentile, box: middle half, line: median", fontsize=11
    )
    panels = figure.subplots(lines, _COLUMNS, squeeze=False).flatten()
    for axes, row in zip(panels, used, strict=False):
        _draw_stages(axes, row)
    for axes in panels[len(used) :]:
        axes.set_axis_off()
    write_picture(path, figure_image(figure))


def _draw_stages(axes: "Axes", row: LedgerRow) -> None:
    axes.set_title(f"{row.topic} > {row.consumer}   n = {row.applied}", fontsize=10, loc="left")
    axes.set_xscale("log")
    axes.set_xlim(0.8 * _SHORTEST, _LONGEST)
    axes.xaxis.set_major_formatter("{x:g}")
    axes.set_xlabel("latency [ms]", fontsize=8)
    axes.grid(axis="x", color=GRID_COLOUR)
    axes.set_yticks(range(len(STAGES)), STAGES)
    axes.set_ylim(len(STAGES) - 0.5, -0.5)
    axes.tick_params(labelsize=8)
    for position, stage in enumerate(STAGES):
        milliseconds = 1e3 * row.samples[stage]
        if not np.any(milliseconds > 0.0):
            continue  # Nothing was injected, or the times of this stage are not known.
        axes.boxplot(
            np.clip(milliseconds, _SHORTEST, _LONGEST),
            positions=[position],
            orientation="horizontal",
            manage_ticks=False,
            whis=(1, 99),
            showfliers=False,
            showcaps=False,
            widths=0.6,
            patch_artist=True,
            boxprops={
                "facecolor": _TOTAL_COLOUR if stage == "total" else _STAGE_COLOUR,
                "linewidth": 0,
            },
            whiskerprops={"color": _WHISKER_COLOUR, "linewidth": 3},
            medianprops={"color": "black", "linewidth": 2},
        )
