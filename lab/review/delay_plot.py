"""Plot histograms of delays, one panel per link."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lab.review.figure import figure_image, new_figure
from lab.review.frames import write_picture

_BINS = 100
_WIDTH, _HEIGHT = 720, 250
"""Size of a panel [pixels]."""
_COLOURS = ("#d66030", "#3c8c3c", "#8c3ca0")
"""Colours of the marks, in their order."""


@dataclass(frozen=True)
class Panel:
    """One histogram of delays [s], with named vertical lines, e.g. the requested mean [s]."""

    title: str
    delays: Sequence[float]
    marks: Sequence[tuple[str, float]] = ()


def write_histograms(path: Path, panels: Sequence[Panel], columns: int = 1) -> None:
    """Write a PNG of panels; each axis ends at the 99.5th percentile, or further if a mark does.

    Raises:
        ConfigError: Matplotlib is not installed.
        LabError: the file cannot be written.
    """
    rows = -(-len(panels) // columns)
    figure = new_figure(_WIDTH * columns, _HEIGHT * rows)
    for number, panel in enumerate(panels, start=1):
        axes = figure.add_subplot(rows, columns, number)
        delays = 1e3 * np.asarray(panel.delays, float)
        marks = [1e3 * seconds for _, seconds in panel.marks]
        longest = max(1.0, *marks, float(np.percentile(delays, 99.5)) if len(delays) else 0.0)
        axes.hist(delays, bins=_BINS, range=(0.0, 1.05 * longest), color="#6c9ec4")
        for (name, _), delay, colour in zip(panel.marks, marks, _COLOURS, strict=False):
            axes.axvline(delay, color=colour, label=f"{name} {delay:.1f} ms")
        axes.set_title(panel.title, fontsize=10, loc="left")
        axes.set_xlim(0.0, 1.05 * longest)
        axes.set_xlabel("delay [ms]", fontsize=8)
        axes.set_ylabel("messages", fontsize=8)
        axes.tick_params(labelsize=8)
        if marks:
            axes.legend(fontsize=8, frameon=False)
    write_picture(path, figure_image(figure))
