"""Statistics of a data set by which training code normalises it: range, mean, std, quantiles."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from common.episodes.episode_file import Image

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
Stats = dict[str, list[Any]]
"""Lists by name: min, max, mean, std, the quantiles, and count."""
PICTURE_STRIDE = 4
"""Only every fourth picture is counted, since neighbours are alike."""
_LEVELS = 256
_COUNTED_SIZE = 200
"""Of larger pictures only every second, third ... pixel is counted, so that this size is left."""


_PAIRS = (("q01", "q99", "min", "max"), ("q10", "q90", "q01", "q99"))
"""Quantiles between which training code may scale, and the wider limits if they coincide."""
_COINCIDE = 0.01
"""Quantiles nearer than this share of the range would blow the rest of it up a hundredfold."""


def column_stats(values: NDArray[np.generic]) -> Stats:
    """Return the statistics of each column of ``values``, (rows, columns) or (rows,).

    Where two quantiles coincide, as those of something rare, the wider limits take their place:
    code that maps ``q01 ... q99`` to -1 ... 1 would otherwise divide by nothing.
    """
    table = _table(values)
    quantiles = np.quantile(table, list(QUANTILES.values()), axis=0)
    found = {"min": table.min(axis=0), "max": table.max(axis=0)}
    found |= dict(zip(QUANTILES, quantiles, strict=True))
    span = found["max"] - found["min"]
    for low, high, least, most in _PAIRS:
        coincide = found[high] - found[low] <= _COINCIDE * span
        found[low] = np.where(coincide, found[least], found[low])
        found[high] = np.where(coincide, found[most], found[high])
    found |= {"mean": table.mean(axis=0), "std": table.std(axis=0)}
    return {name: list(row.tolist()) for name, row in found.items()} | {"count": [len(table)]}


def rare_columns(values: NDArray[np.generic]) -> list[int]:
    """Return the columns of ``values`` (rows, columns) that are the same in all but few rows."""
    table = _table(values)
    low, high = np.quantile(table, [QUANTILES["q01"], QUANTILES["q99"]], axis=0)
    span = table.max(axis=0) - table.min(axis=0)
    return np.flatnonzero((span > 0.0) & (high - low <= _COINCIDE * span)).tolist()


def _table(values: NDArray[np.generic]) -> NDArray[np.float64]:
    return values.reshape(len(values), -1).astype(np.float64)


class PictureStats:
    """Statistics of each colour of many pictures, 0 to 1, from a histogram of its levels."""

    def __init__(self) -> None:
        self._counts = np.zeros((3, _LEVELS), dtype=np.int64)
        self._pictures = 0

    def add(self, picture: Image) -> None:
        """Count the pixels of a picture (height, width, 3), or enough of them."""
        step = max(1, max(picture.shape[:2]) // _COUNTED_SIZE)
        pixels = picture[::step, ::step].reshape(-1, 3)
        for colour in range(3):
            self._counts[colour] += np.bincount(pixels[:, colour], minlength=_LEVELS)
        self._pictures += 1

    def merge(self, other: "PictureStats") -> None:
        """Add the counts of ``other``."""
        self._counts += other._counts
        self._pictures += other._pictures

    def stats(self) -> Stats:
        """Return the statistics, each (3, 1, 1), of one picture or more."""
        levels = np.arange(_LEVELS) / (_LEVELS - 1)
        share = self._counts / self._counts.sum(axis=1, keepdims=True)
        mean = share @ levels
        variance = share @ levels**2 - mean**2
        below = np.cumsum(share, axis=1)
        present = self._counts > 0
        found = {
            "min": levels[present.argmax(axis=1)],
            "max": levels[_LEVELS - 1 - present[:, ::-1].argmax(axis=1)],
            "mean": mean,
            "std": np.sqrt(np.maximum(variance, 0.0)),
            # A little less, since the shares do not add up to 1 exactly.
            **{n: levels[(below >= q - 1e-9).argmax(axis=1)] for n, q in QUANTILES.items()},
        }
        shaped: Stats = {name: list(v.reshape(3, 1, 1).tolist()) for name, v in found.items()}
        return shaped | {"count": [self._pictures]}
