"""Plot the robot's path from above beside the path that its gaits commanded."""

from math import cos, sin

import numpy as np

from lab.review.figure import GRID_COLOUR, figure_image, new_figure
from lab.review.frames import Image
from lab.review.scoring import planar_pose
from lab.review.timeline import Timeline

_SWAY_COLOUR, _WALKED_COLOUR, _COMMANDED_COLOUR = "#b0c4de", "#1450aa", "#d6601e"
_ARROW = 0.08
"""Length of a heading arrow [m]."""
_SURROUNDINGS = 0.15
"""Floor shown around the start at least [m], so that standing still is not magnified."""


def plot_path(timeline: Timeline, width: int, height: int) -> Image:
    """Draw the path as a (height, width, 3) RGB image, with the robot's x up and its y left.

    A pale line shows every ground truth, sway included; arrows show pose and heading at the end
    of each completed gait; rings show where these gaits, one after the other, should have led.

    Raises:
        ConfigError: Matplotlib is not installed.
    """
    poses = [planar_pose(state) for state in timeline.truth]
    first = poses[timeline.gaits[0].start] if timeline.gaits else poses[0]
    reached = [first, *(poses[span.end] for span in timeline.gaits)]
    wanted = [first]
    for span in timeline.gaits:
        wanted.append(wanted[-1].then(timeline.commanded[span.gait]))

    figure = new_figure(width, height)
    axes = figure.add_subplot()
    axes.set_title("path from above", fontsize=9)
    axes.plot(
        [pose.y for pose in poses], [pose.x for pose in poses],
        color=_SWAY_COLOUR, linewidth=1, label="walked",
    )  # fmt: skip
    axes.quiver(
        [pose.y for pose in reached], [pose.x for pose in reached],
        [_ARROW * sin(pose.yaw) for pose in reached], [_ARROW * cos(pose.yaw) for pose in reached],
        angles="xy", scale_units="xy", scale=1.0, width=0.004, headwidth=5,
        headlength=6, color=_WALKED_COLOUR, label="end of a gait", zorder=3,
    )  # fmt: skip
    axes.plot(
        [pose.y for pose in wanted], [pose.x for pose in wanted], "o",
        markersize=8, markerfacecolor="none", color=_COMMANDED_COLOUR, label="commanded",
    )  # fmt: skip
    axes.set_xlabel("y, to the left [m]", fontsize=8)
    axes.set_ylabel("x, ahead [m]", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.grid(color=GRID_COLOUR)
    around = _SURROUNDINGS * np.array([[-1.0, -1.0], [1.0, 1.0]])
    axes.update_datalim(np.array([first.y, first.x]) + around)
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_xaxis()
    axes.legend(loc="upper left", fontsize=7)
    return figure_image(figure)
