"""One sheet that tells how a task was done: from outside, and through the robot's eye."""

from collections.abc import Callable, Iterator, Sequence

import cv2
import numpy as np

from common.schemas import TaskStatus, TaskVerdict
from lab.review.film import Film, picture_at
from lab.review.frames import Image, Progress, caption, decoded, fitted
from lab.review.task_film import task_moments, trial_seconds
from services.sim.rendering.render import FollowCamera, contact_sheet, render_states, task_view
from services.sim.scenes.base import View

TILE = (360, 270)
"""Width and height of one picture [pixels]."""
COLUMNS = 4
ROWS = 2
"""Of pictures from outside, at least."""
_HEAD = 30

Eye = Callable[[int], Image | None]
"""The left eye's picture at a ground truth; None: there is none."""


def headline(film: Film, status: TaskStatus) -> str:
    """Task, seed, verdict and operator in one line; ``status`` is the last of the film."""
    words = f"{status.task}  seed {status.seed}  "
    if status.verdict is TaskVerdict.RUNNING:
        words += f"no verdict after {status.time:.1f} s"
    else:
        words += f"{status.verdict.name} after {status.time:.1f} s"
    operator = film.script.removesuffix(status.task).strip()
    return f"{words}   operator: {operator}" if operator else words


def scene_pictures(
    film: Film,
    indices: Sequence[int],
    width: int,
    height: int,
    camera: FollowCamera | View | None = None,
    *,
    fast: bool = False,
) -> Iterator[Image]:
    """Render ground truths of a film in their scene.

    Args:
        film: what was recorded.
        indices: of ground truths, in the order of time.
        width: [pixels].
        height: [pixels].
        camera: None: the one that shows the film's task best.
        fast: see :func:`services.sim.rendering.render.render_states`.

    Raises:
        RenderingUnavailableError: there is no off-screen OpenGL.
        SceneError: the scene is not known, or changed within the film.
    """
    if camera is None:
        camera = task_view(film.task.task if film.task else "", film.scene)
    return render_states(
        (film.truth[index] for index in indices),
        *(width, height, camera),
        scene=film.scene,
        objects=film.things(indices),
        fast=fast,
    )


def recorded_eye(film: Film) -> Eye:
    """The left eye's pictures as they were recorded."""

    def at(index: int) -> Image | None:
        frame = picture_at(film.left, index)
        return None if frame is None else decoded(frame)

    return at


def task_sheet(
    film: Film,
    title: str,
    eye: Eye,
    progress: Progress,
    camera: FollowCamera | View | None = None,
) -> Image:
    """Draw the moments of a task, the last row through the robot's eye.

    Args:
        film: of the run; it has a task.
        title: above the pictures.
        eye: the robot's left one.
        progress: told of every picture.
        camera: see :func:`scene_pictures`.

    Raises:
        RenderingUnavailableError: there is no off-screen OpenGL.
        SceneError: the scene is not known, or changed within the film.
    """
    chosen = task_moments(film, ROWS * COLUMNS)
    tiles: list[Image] = []
    images = scene_pictures(film, [moment.index for moment in chosen], *TILE, camera)
    for moment, image in zip(chosen, images, strict=True):
        tiles.append(caption(image, f"{trial_seconds(film, moment.index):5.1f} s  {moment.label}"))
        progress(len(tiles), len(chosen))
    # Those of the second halves: at the start the eye sees what the first picture shows.
    last = (
        np.linspace(min(1, len(chosen) - 1), len(chosen) - 1, COLUMNS).round().astype(int).tolist()
    )
    for index in dict.fromkeys(chosen[number].index for number in last):
        picture = eye(index)
        if picture is not None:
            text = f"{trial_seconds(film, index):5.1f} s  through the robot's left eye"
            tiles.append(caption(fitted(picture, *TILE), text))
    sheet = contact_sheet(tiles, COLUMNS)
    return np.concatenate((_head(title, sheet.shape[1]), sheet))


def _head(title: str, width: int) -> Image:
    strip = np.full((_HEAD, width, 3), 255, np.uint8)
    text = title.encode("ascii", "replace").decode()
    cv2.putText(strip, text, (6, 21), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (0, 0, 0), 1, cv2.LINE_AA)
    return strip
