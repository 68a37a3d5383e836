"""Normalisation: computed once from the data set, kept with the checkpoint."""

from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from common.schemas.arrays import Float64Array as Array
from services.policy.configuration import StrictModel


class Statistics(StrictModel):
    """Mean and scale of each number of a vector.

    Attributes:
        mean: of each number.
        scale: its standard deviation, at least a floor: a number that hardly moves in the data set
            must not shout when it does in service.
    """

    mean: tuple[float, ...]
    scale: tuple[float, ...]

    @model_validator(mode="after")
    def _fit_together(self) -> Self:
        if len(self.mean) != len(self.scale) or not all(scale > 0.0 for scale in self.scale):
            raise ValueError(
                f"expected as many positive scales as means, got {len(self.mean)} means and "
                f"{len(self.scale)} scales, the least {min(self.scale, default=0.0):g}"
            )
        return self

    @classmethod
    def of(cls, rows: Array, floor: float) -> Self:
        """Return the statistics of the last axis of ``rows`` (..., n)."""
        flat = rows.reshape(-1, rows.shape[-1])
        scale = np.maximum(flat.std(axis=0), floor)
        return cls(mean=tuple(flat.mean(axis=0).tolist()), scale=tuple(scale.tolist()))

    @property
    def width(self) -> int:
        """Length of the vector."""
        return len(self.mean)

    def normalise(self, values: Array) -> NDArray[np.float32]:
        """Return ``values`` (..., n) less the mean, in units of the scale."""
        mean, scale = self._arrays
        return ((values - mean) / scale).astype(np.float32)

    def restore(self, values: NDArray[np.float32]) -> Array:
        """Return the inverse of :meth:`normalise`."""
        mean, scale = self._arrays
        return np.asarray(values, dtype=np.float64) * scale + mean

    @cached_property
    def _arrays(self) -> tuple[Array, Array]:
        return np.array(self.mean), np.array(self.scale)
