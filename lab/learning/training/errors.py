"""How wrong estimates of the scene are, which depends on what there is to see."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]
NEAREST = 30
"""Views over which an error is averaged."""


class EstimationErrors(NamedTuple):
    """Errors on n held-out views, of m numbers of the scene; all in normalised units.

    Attributes:
        truth: (n, m) the true numbers.
        wrong: (n, m) what the estimates are off by.
    """

    truth: Array
    wrong: Array

    @property
    def overall(self) -> Array:
        """Root mean square over all views (m,)."""
        found: Array = np.sqrt(np.square(self.wrong).mean(axis=0))
        return found

    def near(self, scene: Array) -> Array:
        """Return the root mean square (f, m) over the views that are most like each scene (f, m).

        An object that a hand covers is found less well, and one that is far aside; a policy that
        was trained with the mean of both would trust neither where it may.
        """
        count = min(NEAREST, len(self.truth))
        found = np.empty_like(scene)
        for part in np.array_split(np.arange(len(scene)), -(-len(scene) // 1000)):
            distances = np.square(scene[part, None] - self.truth).sum(axis=2)
            nearest = np.argpartition(distances, count - 1, axis=1)[:, :count]
            found[part] = np.sqrt(np.square(self.wrong[nearest]).mean(axis=1))
        return found
