"""Estimates with their 95 % confidence intervals.

Imported only for a report, because scipy.stats is slow to import.
"""

from collections.abc import Sequence

import numpy as np
from pydantic import BaseModel, ConfigDict
from scipy.stats import binomtest, bootstrap

_RESAMPLES = 10_000
_SEED = 20_231
"""Seed of the bootstrap: the same trials give the same intervals."""


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Estimate(_Record):
    """A mean with its 95 % confidence interval.

    Attributes:
        mean: the mean; None: there are no data.
        low: lower end of the interval; None: there are too few data.
        high: upper end of the interval; None: there are too few data.
        count: number of data.
    """

    mean: float | None = None
    low: float | None = None
    high: float | None = None
    count: int = 0

    def text(self, form: str) -> str:
        """Format as ``8.7 [8.3, 9.0]`` with numbers like ``form``; ``none`` without data."""
        if self.mean is None:
            return "none"
        if self.low is None or self.high is None:
            return f"{self.mean:{form}}"
        return f"{self.mean:{form}} [{self.low:{form}}, {self.high:{form}}]"


class Proportion(_Record):
    """A proportion with its 95 % confidence interval.

    Attributes:
        share: the proportion.
        low: lower end of the interval.
        high: upper end of the interval.
    """

    share: float
    low: float
    high: float


def proportion(count: int, total: int) -> Proportion:
    """Estimate a proportion, with Wilson's score interval.

    Raises:
        ValueError: ``total`` is not positive.
    """
    interval = binomtest(count, total).proportion_ci(0.95, method="wilson")
    return Proportion(share=count / total, low=float(interval.low), high=float(interval.high))


def mean_estimate(values: Sequence[float]) -> Estimate:
    """Estimate a mean, with its percentile bootstrap interval; this needs two values or more."""
    if len(values) < 2:
        return Estimate(mean=values[0] if values else None, count=len(values))
    interval = bootstrap(
        (values,),
        np.mean,
        confidence_level=0.95,
        n_resamples=_RESAMPLES,
        method="percentile",
        rng=np.random.default_rng(_SEED),
    ).confidence_interval
    return Estimate(
        mean=float(np.mean(values)),
        low=float(interval.low),
        high=float(interval.high),
        count=len(values),
    )
