"""Decode, scale, caption and write images, all (height, width, 3) RGB arrays. Needs OpenCV."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from common.files import write_whole
from common.schemas import CameraFrame
from lab.errors import LabError

Image = NDArray[np.uint8]
OnProgress = Callable[[int, int], None]
"""Called with the number of finished steps and their total."""

_JPEG_QUALITIES = (88, 82, 76, 70, 62, 54, 46)
_WHITE, _SHADE = (255, 255, 255), (20, 24, 28)


def decode_frame(frame: CameraFrame) -> Image:
    """Decode a camera message; the image is black if the message is damaged."""
    black = np.zeros((frame.height, frame.width, 3), np.uint8)
    content = np.frombuffer(frame.data, np.uint8)
    if frame.encoding == "rgb8":
        return content.reshape(black.shape) if content.size == black.size else black
    # OpenCV raises on empty data and returns None for damaged data.
    image = cv2.imdecode(content, cv2.IMREAD_COLOR) if content.size else None
    if image is None:
        return black
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def with_caption(image: Image, text: str) -> Image:
    """Return a copy of ``image`` with ``text`` (ASCII) on a dark strip along its top edge."""
    labelled = np.ascontiguousarray(image).copy()
    height = 24
    labelled[:height] = (labelled[:height] * 0.25 + np.array(_SHADE) * 0.75).astype(np.uint8)
    plain = text.encode("ascii", "replace").decode()
    (width, _), _ = cv2.getTextSize(plain, cv2.FONT_HERSHEY_SIMPLEX, 0.5, 1)
    scale = min(0.5, 0.5 * (image.shape[1] - 12) / max(1, width))
    cv2.putText(labelled, plain, (6, 17), cv2.FONT_HERSHEY_SIMPLEX, scale, _WHITE, 1, cv2.LINE_AA)
    return labelled


def letterbox(image: Image, width: int, height: int) -> Image:
    """Scale ``image`` to fit and centre it on a dark background."""
    share = min(width / image.shape[1], height / image.shape[0])
    size = (round(image.shape[1] * share), round(image.shape[0] * share))
    background = np.full((height, width, 3), _SHADE, np.uint8)
    left, top = (width - size[0]) // 2, (height - size[1]) // 2
    scaled = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    background[top : top + size[1], left : left + size[0]] = scaled
    return background


def write_picture(path: Path, image: Image, *, largest_jpeg: int | None = None) -> None:
    """Write ``image`` in the format of the file name's suffix, atomically.

    Args:
        path: the file.
        image: the picture.
        largest_jpeg: size that a JPEG file should have at most, at the best quality possible
            [bytes]; None: the usual quality.

    Raises:
        LabError: the file cannot be written, or the suffix is not that of an image format.
    """
    # Not with imwrite, which returns success on a full disk.
    if not cv2.haveImageWriter(str(path)):
        raise LabError(f"cannot write {path}: expected a name such as picture.png")
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    _, encoded = cv2.imencode(path.suffix, bgr)
    if largest_jpeg is not None and path.suffix.lower() in {".jpg", ".jpeg"}:
        for quality in _JPEG_QUALITIES:
            _, encoded = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])
            if encoded.size <= largest_jpeg:
                break
    try:
        write_whole(path, encoded.tobytes())
    except OSError as error:
        raise LabError(f"cannot write {path}: {error.strerror}") from error
