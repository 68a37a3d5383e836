"""Draw the contact sheet of a scored task: from outside, and from the robot's left camera."""

from collections.abc import Callable
from functools import partial

import cv2
import numpy as np

from common.schemas import TaskStatus, TaskVerdict
from lab.review.frames import Image, OnProgress, decode_frame, letterbox, with_caption
from lab.review.task_moments import task_moments, trial_seconds
from lab.review.tiles import moment_tiles
from lab.review.timeline import Timeline
from services.sim.rendering.render import FollowCamera, contact_sheet
from services.sim.scenes.base import View

TILE = (360, 270)
"""Width and height of one picture [pixels]."""
COLUMNS = 4
ROWS = 2
"""Least number of rows of pictures from outside."""
_TITLE_HEIGHT = 30

CameraImages = Callable[[int], Image | None]
"""Returns the image of the robot's left camera at an index; None if there is none."""


def task_title(timeline: Timeline, status: TaskStatus) -> str:
    """Format task, seed, verdict and operator in one line from the last ``status``."""
    running = status.verdict is TaskVerdict.RUNNING
    verdict = "no verdict" if running else status.verdict.name
    title = f"{status.task}  seed {status.seed}  {verdict} after {status.time:.1f} s"
    operator = timeline.operator_script.removesuffix(status.task).strip()
    return f"{title}   operator: {operator}" if operator else title


def recorded_images(timeline: Timeline) -> CameraImages:
    """Return the left camera's images as they were recorded."""

    def at(index: int) -> Image | None:
        frame = timeline.left_images.at(index)
        return None if frame is None else decode_frame(frame)

    return at


def task_contact_sheet(
    timeline: Timeline,
    title: str,
    left_camera: CameraImages,
    on_progress: OnProgress,
    camera: FollowCamera | View | None = None,
) -> Image:
    """Draw the moments of a task under a ``title``; the last row shows the left camera's images.

    The other pictures are from outside, by ``camera`` as in :func:`lab.review.tiles.render_scene`;
    ``on_progress`` is called after each.

    Raises:
        RenderingUnavailableError: off-screen OpenGL is not available.
        SceneError: the scene is unknown, or changed during the run.
    """
    chosen = task_moments(timeline, ROWS * COLUMNS)
    seconds = partial(trial_seconds, timeline)
    tiles = moment_tiles(timeline, chosen, TILE, camera, seconds, on_progress)
    # Not the first moment: at the start the camera sees what the first picture shows.
    last = len(chosen) - 1
    for number in dict.fromkeys(np.linspace(min(1, last), last, COLUMNS).round().astype(int)):
        index = chosen[number].index
        image = left_camera(index)
        if image is not None:
            text = f"{seconds(index):5.1f} s  through the robot's left eye"
            tiles.append(with_caption(letterbox(image, *TILE), text))
    sheet = contact_sheet(tiles, COLUMNS)
    return np.concatenate((_title_strip(title, sheet.shape[1]), sheet))


def _title_strip(title: str, width: int) -> Image:
    strip = np.full((_TITLE_HEIGHT, width, 3), 255, np.uint8)
    text = title.encode("ascii", "replace").decode()
    cv2.putText(strip, text, (6, 21), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (0, 0, 0), 1, cv2.LINE_AA)
    return strip
