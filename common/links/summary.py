"""Mean, spread and percentiles of delays: as a specification requests them, and as measured."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from common.links.spec import Distribution, LinkSpec

_Z99 = 2.3263478740408408
"""99th percentile of the standard normal distribution."""


class DelaySummary(NamedTuple):
    """A distribution of delays in four numbers [s]; ``sd`` is the standard deviation."""

    mean: float
    sd: float
    p50: float
    p99: float


def summarize(delays: npt.ArrayLike) -> DelaySummary:
    """Summarize delays [s]; zeros without data. Percentiles are values that occur."""
    values = np.asarray(delays, np.float64)
    if not values.size:
        return DelaySummary(0.0, 0.0, 0.0, 0.0)
    p50, p99 = np.quantile(values, (0.5, 0.99), method="inverted_cdf")
    return DelaySummary(float(values.mean()), float(values.std()), float(p50), float(p99))


def requested(spec: LinkSpec) -> DelaySummary:
    """Summarize the distribution a specification requests; ``normal`` before clamping at 0."""
    if spec.distribution is Distribution.TRACE:
        return summarize(spec.trace)
    if spec.distribution is Distribution.LOGNORMAL:
        mu, sigma = lognormal_parameters(spec)
        return DelaySummary(spec.mean, spec.sd, math.exp(mu), math.exp(mu + _Z99 * sigma))
    return DelaySummary(spec.mean, spec.sd, spec.mean, spec.mean + _Z99 * spec.sd)


def lognormal_parameters(spec: LinkSpec) -> tuple[float, float]:
    """Return mu and sigma of the delay's logarithm from the delay's mean and standard deviation."""
    variance = math.log1p((spec.sd / spec.mean) ** 2)
    return math.log(spec.mean) - 0.5 * variance, math.sqrt(variance)
