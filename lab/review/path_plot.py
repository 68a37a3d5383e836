"""The robot's path seen from above, beside the path its gaits should have made."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, floor, sin
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from common.robot.pose import Pose2
from common.schemas import Gait
from lab.review.film import Film
from lab.review.scoring import planar_pose

_PAPER, _GRID, _TEXT = (248, 248, 246), (222, 222, 218), (90, 90, 90)
_SWAY, _WALKED, _COMMANDED = (176, 196, 222), (20, 80, 170), (214, 96, 30)
_GRID_STEP = 0.2
"""Between the lines of the grid [m]."""
_MARGIN = 34


@dataclass(frozen=True)
class _View:
    """Maps floor coordinates to pixels: x (forward) up, y (left) to the left."""

    scale: float
    x: float
    y: float
    width: int
    height: int

    def pixel(self, x: float, y: float) -> tuple[int, int]:
        return (
            round(self.width / 2 - (y - self.y) * self.scale),
            round(self.height / 2 - (x - self.x) * self.scale),
        )


def plot_path(
    film: Film, commanded: Mapping[Gait, Pose2], width: int, height: int
) -> NDArray[np.uint8]:
    """Draw the path as a (height, width, 3) RGB picture.

    Pale: every ground truth, sway included. Dark, with headings: where each gait ended. Orange
    rings: where the completed gaits should have led, one after the other.
    """
    image = np.empty((height, width, 3), np.uint8)
    image[:] = _PAPER
    poses = [planar_pose(state) for state in film.truth]
    if not poses:
        return image
    stops = [poses[stride.end] for stride in film.strides]
    first = poses[film.strides[0].start] if film.strides else poses[0]
    wanted = [first]
    for stride in film.strides:
        wanted.append(wanted[-1].then(commanded.get(stride.gait, Pose2())))
    view = _fit([*poses, *wanted], width, height)
    _draw_grid(image, view)
    points = np.array([view.pixel(pose.x, pose.y) for pose in poses], np.int32)
    cv2.polylines(image, [points.reshape(-1, 1, 2)], False, _SWAY, 1, cv2.LINE_AA)
    for pose in wanted:
        cv2.circle(image, view.pixel(pose.x, pose.y), 6, _COMMANDED, 1, cv2.LINE_AA)
    for pose in (first, *stops):
        _draw_heading(image, view, pose)
    _write(image, f"grid {_GRID_STEP:g} m", (8, height - 10))
    return image


def _fit(poses: list[Pose2], width: int, height: int) -> _View:
    xs, ys = [pose.x for pose in poses], [pose.y for pose in poses]
    span_x, span_y = max(max(xs) - min(xs), 0.6), max(max(ys) - min(ys), 0.6)
    scale = min((height - 2 * _MARGIN) / span_x, (width - 2 * _MARGIN) / span_y)
    return _View(scale, (max(xs) + min(xs)) / 2, (max(ys) + min(ys)) / 2, width, height)


def _draw_grid(image: Any, view: _View) -> None:
    half_x = view.height / 2 / view.scale
    half_y = view.width / 2 / view.scale
    for number in range(floor((view.x - half_x) / _GRID_STEP), 1000):
        row = view.pixel(number * _GRID_STEP, view.y)[1]
        if row < 0:
            break
        cv2.line(image, (0, row), (view.width, row), _GRID, 1)
    for number in range(floor((view.y - half_y) / _GRID_STEP), 1000):
        column = view.pixel(view.x, number * _GRID_STEP)[0]
        if column < 0:
            break
        cv2.line(image, (column, 0), (column, view.height), _GRID, 1)


def _draw_heading(image: Any, view: _View, pose: Pose2) -> None:
    tip = (pose.x + 0.08 * cos(pose.yaw), pose.y + 0.08 * sin(pose.yaw))
    start = view.pixel(pose.x, pose.y)
    cv2.circle(image, start, 3, _WALKED, -1, cv2.LINE_AA)
    cv2.arrowedLine(image, start, view.pixel(*tip), _WALKED, 1, cv2.LINE_AA, tipLength=0.35)


def _write(image: Any, text: str, place: tuple[int, int]) -> None:
    cv2.putText(image, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.42, _TEXT, 1, cv2.LINE_AA)
