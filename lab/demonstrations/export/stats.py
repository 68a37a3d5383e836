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


def column_stats(values: NDArray[np.generic]) -> Stats:
    """Return the statistics of each column of ``values``, (rows, columns) or (rows,)."""
    table = values.reshape(len(values), -1).astype(np.float64)
    quantiles = np.quantile(table, list(QUANTILES.values()), axis=0)
    return {
        "min": table.min(axis=0).tolist(),
        "max": table.max(axis=0).tolist(),
        "mean": table.mean(axis=0).tolist(),
        "std": table.std(axis=0).tolist(),
        "count": [len(table)],
        **{name: row.tolist() for name, row in zip(QUANTILES, quantiles, strict=True)},
    }


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
