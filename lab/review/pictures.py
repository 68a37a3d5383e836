"""Contact sheet and video of a run, rendered anew from its log. Needs OpenGL, OpenCV and FFmpeg.

Colours are RGB throughout; OpenCV's BGR order is met only where files are read and written.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import cv2
import imageio_ffmpeg
import numpy as np

from common.schemas import Gait
from lab.errors import LabError
from lab.review.film import RATE, Film, Moment, frame_step, moments, picture_at
from lab.review.frames import Image, Progress, caption, decoded, fitted, write_picture
from lab.review.path_plot import plot_path
from lab.review.scoring import Pose2
from lab.review.task_film import standing_at
from lab.review.task_sheet import headline, recorded_eye, scene_pictures, task_sheet
from services.sim.rendering.render import FollowCamera, contact_sheet

TILE = (480, 270)
"""Width and height of one picture of the contact sheet."""
COLUMNS = 4
VIDEO = (640, 360)
LONGEST_VIDEO = 240.0
"""A longer run is shown faster [s]."""
_NEAR = FollowCamera(distance=2.3, height=0.66, lag=0.01)


def write_contact_sheet(
    path: Path, film: Film, commanded: Mapping[Gait, Pose2], progress: Progress
) -> None:
    """Write the key moments, the robot's own view and its path as one PNG.

    Of a run with a scored task: how the task was done, in its scene.

    Raises:
        RenderingUnavailableError: there is no off-screen OpenGL.
        LabError: there is nothing to show, or the file cannot be written.
    """
    if not film.truth:
        raise LabError("the log has no ground truth (plant/truth) to draw pictures from")
    if film.task is not None:
        sheet = task_sheet(film, headline(film, film.task), recorded_eye(film), progress)
    else:
        sheet = _sheet(film, commanded, progress)
    write_picture(path, sheet)


def _sheet(film: Film, commanded: Mapping[Gait, Pose2], progress: Progress) -> Image:
    chosen = moments(film)
    tiles = []
    indices = [moment.index for moment in chosen]
    images = scene_pictures(film, indices, *TILE, _NEAR if film.scene == "flat" else None)
    for moment, image in zip(chosen, images, strict=True):
        text = f"{film.seconds(moment.index):5.1f} s  {moment.label}"
        tiles.append(caption(image, text))
        progress(len(tiles), len(chosen))
    tiles += _eyes(film, chosen)
    tiles.append(plot_path(film, commanded, *TILE))
    return contact_sheet(tiles, COLUMNS)


def write_video(path: Path, film: Film, progress: Progress) -> None:
    """Write an MP4 of the run at its real pace, with the left eye's view in a corner.

    A run longer than :data:`LONGEST_VIDEO` is shown faster.

    Raises:
        RenderingUnavailableError: there is no off-screen OpenGL.
        LabError: there is nothing to show, or FFmpeg failed.
    """
    if not film.truth:
        raise LabError("the log has no ground truth (plant/truth) to make a video from")
    indices = range(0, len(film.truth), frame_step(film, round(LONGEST_VIDEO * RATE)))
    writer = imageio_ffmpeg.write_frames(
        str(path), VIDEO, fps=RATE, codec="libx264", quality=7, macro_block_size=8
    )
    writer.send(None)
    try:
        for done, image in enumerate(_video_frames(film, indices), start=1):
            writer.send(np.ascontiguousarray(image))
            progress(done, len(indices))
    except OSError as error:
        raise LabError(f"cannot write {path}: {error}") from error
    finally:
        writer.close()


def _video_frames(film: Film, indices: Sequence[int]) -> Iterator[Image]:
    for index, image in zip(indices, scene_pictures(film, indices, *VIDEO, fast=True), strict=True):
        eye = picture_at(film.left, index)
        if eye is not None:
            _inset(image, decoded(eye))
        words = film.label_at(index) if film.task is None else standing_at(film, index)
        yield caption(image, f"{film.seconds(index):5.1f} s  {words}")


def _eyes(film: Film, chosen: Sequence[Moment]) -> list[Image]:
    """Both eyes' pictures at the moment that shows the grippers best; none without cameras."""
    best = max(chosen, key=lambda moment: float(max(film.truth[moment.index].gripper_closure)))
    tiles = []
    for name, pictures in (("left", film.left), ("right", film.right)):
        picture = picture_at(pictures, best.index)
        if picture is not None:
            text = f"{film.seconds(best.index):5.1f} s  the robot's {name} eye"
            tiles.append(caption(fitted(decoded(picture), *TILE), text))
    return tiles


def _inset(image: Image, picture: Image) -> None:
    """Put ``picture`` in the lower right corner of ``image``, a quarter of its width."""
    width = image.shape[1] // 4
    height = round(width * picture.shape[0] / picture.shape[1])
    scaled = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    image[-height - 8 : -8, -width - 8 : -8] = scaled
