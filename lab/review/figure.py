"""Create Matplotlib figures without a display and without pyplot's global state.

Matplotlib takes half a second of CPU time to import, so it is imported only for a plot.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from common.packages import require
from lab.review.frames import Image

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 100
"""Pixels per inch of every figure."""
GRID_COLOUR = "#dededa"


def new_figure(width: int, height: int) -> "Figure":
    """Create an empty figure of ``width`` x ``height`` pixels that lays its axes out by itself.

    Raises:
        ConfigError: Matplotlib is not installed.
    """
    require("a plot", "deploy", "matplotlib")
    from matplotlib.figure import Figure

    return Figure(figsize=(width / DPI, height / DPI), dpi=DPI, layout="constrained")


def figure_image(figure: "Figure") -> Image:
    """Draw ``figure`` with the Agg backend as a (height, width, 3) RGB image."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    return np.array(canvas.buffer_rgba())[..., :3]
