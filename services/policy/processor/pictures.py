"""Scale pictures to what a network sees, with numpy alone."""

from functools import cache

import numpy as np
from numpy.typing import NDArray

from services.policy.errors import ProcessorError

Picture = NDArray[np.uint8]


def scale_picture(picture: Picture, size: tuple[int, int]) -> Picture:
    """Return ``picture`` (height, width, 3) scaled to ``size`` (width, height) by means of areas.

    A picture that has the size already is returned as it is. Data sets, live pictures and
    evaluation all pass here, so that a network never sees another kind of smoothing.

    Raises:
        ProcessorError: it is no such array, or is smaller than ``size``.
    """
    width, height = size
    if picture.ndim != 3 or picture.shape[2] != 3 or picture.dtype != np.uint8:
        raise ProcessorError(
            f"expected a picture uint8 (height, width, 3), got {picture.dtype} {picture.shape}"
        )
    if picture.shape[:2] == (height, width):
        return picture
    if picture.shape[0] < height or picture.shape[1] < width:
        raise ProcessorError(
            f"expected a picture of at least {width}x{height}, got "
            f"{picture.shape[1]}x{picture.shape[0]}; set the cameras' size higher"
        )
    rows, columns = _means(picture.shape[0], height), _means(picture.shape[1], width)
    # Rows first: the remaining product is then the smaller one.
    flat = rows @ picture.reshape(picture.shape[0], -1).astype(np.float32)
    scaled = columns @ flat.reshape(height, picture.shape[1], 3)
    whole: Picture = np.rint(scaled).astype(np.uint8)
    return whole


@cache
def _means(given: int, wanted: int) -> NDArray[np.float32]:
    """Return the matrix (wanted, given) that takes means over equal parts of an axis."""
    edges = np.linspace(0.0, given, wanted + 1)
    low, high = edges[:-1, None], edges[1:, None]
    pixel = np.arange(given)[None, :]
    overlap = np.minimum(high, pixel + 1) - np.maximum(low, pixel)
    return np.asarray(np.maximum(overlap, 0.0) * wanted / given, dtype=np.float32)
