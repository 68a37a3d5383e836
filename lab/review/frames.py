"""Frames as arrays: read, scaled, captioned, written. RGB throughout; needs OpenCV."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from common.files import write_whole
from common.schemas import CameraFrame
from lab.errors import LabError

Image = NDArray[np.uint8]
Progress = Callable[[int, int], None]
"""Called with (done, of how many)."""

_WHITE, _SHADE = (255, 255, 255), (20, 24, 28)


def decoded(frame: CameraFrame) -> Image:
    """A camera message as (height, width, 3) RGB; black where it is damaged."""
    black = np.zeros((frame.height, frame.width, 3), np.uint8)
    content = np.frombuffer(frame.data, np.uint8)
    if frame.encoding == "rgb8":
        return content.reshape(black.shape) if content.size == black.size else black
    # OpenCV raises on nothing, and says None of garbage.
    image = cv2.imdecode(content, cv2.IMREAD_COLOR) if content.size else None
    if image is None:
        return black
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


def fitted(image: Image, width: int, height: int) -> Image:
    """``image`` scaled to fit, centred on a dark ground."""
    share = min(width / image.shape[1], height / image.shape[0])
    size = (round(image.shape[1] * share), round(image.shape[0] * share))
    ground = np.empty((height, width, 3), np.uint8)
    ground[:] = _SHADE
    left, top = (width - size[0]) // 2, (height - size[1]) // 2
    scaled = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    ground[top : top + size[1], left : left + size[0]] = scaled
    return ground


def write_picture(path: Path, image: Image) -> None:
    """Write ``image`` in the format that the name's ending says, whole or not at all.

    Raises:
        LabError: the file cannot be written, or the name's ending is no picture's.
    """
    # Not by imwrite, which takes a full disk for a success.
    if not cv2.haveImageWriter(str(path)):
        raise LabError(f"cannot write {path}: expected a name such as picture.png")
    _, encoded = cv2.imencode(path.suffix, cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    try:
        write_whole(path, encoded.tobytes())
    except OSError as error:
        raise LabError(f"cannot write {path}: {error.strerror}") from error
