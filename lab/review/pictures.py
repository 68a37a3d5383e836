"""Render the contact sheet and the video of a run from its log. Needs OpenGL, OpenCV and FFmpeg."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import imageio_ffmpeg
import numpy as np

from lab.errors import LabError
from lab.review.frames import (
    Image,
    OnProgress,
    decode_frame,
    letterbox,
    with_caption,
    write_picture,
)
from lab.review.key_moments import Moment, key_moments
from lab.review.path_plot import plot_path
from lab.review.task_contact_sheet import recorded_images, task_contact_sheet, task_title
from lab.review.task_moments import task_caption
from lab.review.tiles import moment_tiles, render_scene
from lab.review.timeline import RATE, Timeline, frame_step
from services.sim.rendering.render import FollowCamera, contact_sheet

TILE = (480, 270)
"""Width and height of one picture of the contact sheet [pixels]."""
COLUMNS = 4
VIDEO = (640, 360)
"""Width and height of the video [pixels]."""
LONGEST_VIDEO = 240.0
"""A longer run is shown faster than it was [s]."""
_NEAR = FollowCamera(distance=2.3, height=0.66, lag=0.01)


def write_contact_sheet(path: Path, timeline: Timeline, on_progress: OnProgress) -> None:
    """Write a PNG of a run's key moments, its camera images and the robot's path.

    For a run with a scored task the sheet shows the moments of the task instead.

    Raises:
        RenderingUnavailableError: off-screen OpenGL is not available.
        LabError: there is no ground truth, or the file cannot be written.
    """
    if not timeline.truth:
        raise LabError("the log has no ground truth (plant/truth) to draw pictures from")
    if timeline.task is not None:
        title, images = task_title(timeline, timeline.task), recorded_images(timeline)
        sheet = task_contact_sheet(timeline, title, images, on_progress)
    else:
        chosen = key_moments(timeline)
        camera = _NEAR if timeline.scene == "flat" else None
        tiles = moment_tiles(timeline, chosen, TILE, camera, timeline.seconds_at, on_progress)
        tiles += [*_camera_tiles(timeline, chosen), plot_path(timeline, *TILE)]
        sheet = contact_sheet(tiles, COLUMNS)
    write_picture(path, sheet)


def write_video(path: Path, timeline: Timeline, on_progress: OnProgress) -> None:
    """Write an MP4 of a run in real time, with the left camera's image in a corner.

    A run longer than :data:`LONGEST_VIDEO` is shown faster.

    Raises:
        RenderingUnavailableError: off-screen OpenGL is not available.
        LabError: there is no ground truth, or FFmpeg failed.
    """
    if not timeline.truth:
        raise LabError("the log has no ground truth (plant/truth) to make a video from")
    step = frame_step(timeline, round(LONGEST_VIDEO * RATE))
    indices = range(0, len(timeline.truth), step)
    writer = imageio_ffmpeg.write_frames(
        str(path), VIDEO, fps=RATE, codec="libx264", quality=7, macro_block_size=8
    )
    writer.send(None)
    try:
        for done, image in enumerate(_video_frames(timeline, indices), start=1):
            writer.send(np.ascontiguousarray(image))
            on_progress(done, len(indices))
    except OSError as error:
        raise LabError(f"cannot write {path}: {error}") from error
    finally:
        writer.close()


def _video_frames(timeline: Timeline, indices: Sequence[int]) -> Iterator[Image]:
    rendered = render_scene(timeline, indices, *VIDEO, fast=True)
    for index, image in zip(indices, rendered, strict=True):
        frame = timeline.left_images.at(index)
        if frame is not None:
            _inset(image, decode_frame(frame))
        label = task_caption(timeline, index) if timeline.task else timeline.label_at(index)
        yield with_caption(image, f"{timeline.seconds_at(index):5.1f} s  {label}")


def _camera_tiles(timeline: Timeline, moments: Sequence[Moment]) -> list[Image]:
    """Return both cameras' images at the moment that shows the grippers most closed."""
    closure = [float(max(timeline.truth[moment.index].gripper_closure)) for moment in moments]
    best = moments[int(np.argmax(closure))].index
    tiles = []
    for name, images in (("left", timeline.left_images), ("right", timeline.right_images)):
        frame = images.at(best)
        if frame is not None:
            text = f"{timeline.seconds_at(best):5.1f} s  the robot's {name} eye"
            tiles.append(with_caption(letterbox(decode_frame(frame), *TILE), text))
    return tiles


def _inset(image: Image, picture: Image) -> None:
    """Put ``picture`` into the lower right corner of ``image``, a quarter of its width."""
    width = image.shape[1] // 4
    height = round(width * picture.shape[0] / picture.shape[1])
    scaled = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    image[-height - 8 : -8, -width - 8 : -8] = scaled
