"""Contact sheet and video of a run, rendered anew from its log. Needs OpenGL, OpenCV and FFmpeg.

Colours are RGB throughout; OpenCV's BGR order is met only where files are read and written.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import cv2
import imageio_ffmpeg
import numpy as np
from numpy.typing import NDArray

from common.schemas import CameraFrame, Gait
from deploy.errors import DeployError
from deploy.film import RATE, Film, Moment, frame_step, moments, picture_at
from deploy.path_plot import plot_path
from deploy.scoring import Pose2
from services.sim.render import FollowCamera, contact_sheet, render_states

Image = NDArray[np.uint8]
Progress = Callable[[int, int], None]
"""Called with (done, of how many)."""

TILE = (480, 270)
"""Width and height of one picture of the contact sheet."""
COLUMNS = 4
VIDEO = (640, 360)
LONGEST_VIDEO = 240.0
"""A longer run is shown faster [s]."""
_NEAR = FollowCamera(distance=2.3, height=0.66, lag=0.01)
_WHITE, _SHADE = (255, 255, 255), (20, 24, 28)


def write_contact_sheet(
    path: Path, film: Film, commanded: Mapping[Gait, Pose2], progress: Progress
) -> None:
    """Write the key moments, the robot's own view and its path as one PNG.

    Raises:
        RenderingUnavailableError: there is no off-screen OpenGL.
        DeployError: there is nothing to show, or the file cannot be written.
    """
    chosen = moments(film)
    if not chosen:
        raise DeployError("the log has no ground truth (plant/truth) to draw pictures from")
    tiles = []
    states = (film.truth[moment.index] for moment in chosen)
    for moment, image in zip(chosen, render_states(states, *TILE, _NEAR), strict=True):
        text = f"{film.seconds(moment.index):5.1f} s  {moment.label}"
        tiles.append(caption(image, text))
        progress(len(tiles), len(chosen))
    tiles += _eyes(film, chosen)
    tiles.append(caption(plot_path(film, commanded, *TILE), "path from above (rings: commanded)"))
    sheet = contact_sheet(tiles, COLUMNS)
    if not cv2.imwrite(str(path), cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR)):
        raise DeployError(f"cannot write {path}")


def write_video(path: Path, film: Film, progress: Progress) -> None:
    """Write an MP4 of the run at its real pace, with the left eye's view in a corner.

    A run longer than :data:`LONGEST_VIDEO` is shown faster.

    Raises:
        RenderingUnavailableError: there is no off-screen OpenGL.
        DeployError: there is nothing to show, or FFmpeg failed.
    """
    if not film.truth:
        raise DeployError("the log has no ground truth (plant/truth) to make a video from")
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
        raise DeployError(f"cannot write {path}: {error}") from error
    finally:
        writer.close()


def _video_frames(film: Film, indices: Sequence[int]) -> Iterator[Image]:
    states = (film.truth[index] for index in indices)
    for index, image in zip(indices, render_states(states, *VIDEO, fast=True), strict=True):
        eye = picture_at(film.left, index)
        if eye is not None:
            _inset(image, decoded(eye))
        yield caption(image, f"{film.seconds(index):5.1f} s  {film.label_at(index)}")


def _eyes(film: Film, chosen: Sequence[Moment]) -> list[Image]:
    """Both eyes' pictures at the moment that shows the grippers best; none without cameras."""
    best = max(chosen, key=lambda moment: float(max(film.truth[moment.index].gripper_closure)))
    tiles = []
    for name, pictures in (("left", film.left), ("right", film.right)):
        picture = picture_at(pictures, best.index)
        if picture is not None:
            text = f"{film.seconds(best.index):5.1f} s  the robot's {name} eye"
            tiles.append(caption(_fitted(decoded(picture), *TILE), text))
    return tiles


def decoded(frame: CameraFrame) -> Image:
    """A camera message as (height, width, 3) RGB; black where a JPEG is damaged."""
    if frame.encoding == "rgb8":
        return np.frombuffer(frame.data, np.uint8).reshape(frame.height, frame.width, 3)
    image = cv2.imdecode(np.frombuffer(frame.data, np.uint8), cv2.IMREAD_COLOR)
    if image is None:
        return np.zeros((frame.height, frame.width, 3), np.uint8)
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def caption(image: Image, text: str) -> Image:
    """A copy of ``image`` with ``text`` (ASCII) on a dark strip along its top edge."""
    labelled = np.ascontiguousarray(image).copy()
    height = 24
    labelled[:height] = (labelled[:height] * 0.25 + np.array(_SHADE) * 0.75).astype(np.uint8)
    plain = text.encode("ascii", "replace").decode()
    scale = min(0.5, 0.5 * (image.shape[1] - 12) / max(1, _width(plain, 0.5)))
    cv2.putText(labelled, plain, (6, 17), cv2.FONT_HERSHEY_SIMPLEX, scale, _WHITE, 1, cv2.LINE_AA)
    return labelled


def _width(text: str, scale: float) -> int:
    (width, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, 1)
    return int(width)


def _fitted(image: Image, width: int, height: int) -> Image:
    """``image`` scaled to fit, centred on a dark ground."""
    share = min(width / image.shape[1], height / image.shape[0])
    size = (round(image.shape[1] * share), round(image.shape[0] * share))
    ground = np.empty((height, width, 3), np.uint8)
    ground[:] = _SHADE
    left, top = (width - size[0]) // 2, (height - size[1]) // 2
    scaled = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    ground[top : top + size[1], left : left + size[0]] = scaled
    return ground


def _inset(image: Image, picture: Image) -> None:
    """Put ``picture`` in the lower right corner of ``image``, a quarter of its width."""
    width = image.shape[1] // 4
    height = round(width * picture.shape[0] / picture.shape[1])
    scaled = cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
    image[-height - 8 : -8, -width - 8 : -8] = scaled
