"""What a link will do to messages at a given rate, told before it is used.

Pure: seeded simulations through the same :class:`~common.links.delay.DelayLine` that delays the
messages, with arrivals at even intervals. The mean is predicted as the requested one plus what
clamping at 0 adds (known exactly) plus what keeping the order adds (simulated, against the same
draws), so that little of it is the chance of a finite simulation; how much is known from several.
"""

import math
from dataclasses import dataclass

from common.errors import ConfigError
from common.links.delay import DelayLine, lognormal_parameters, requested
from common.links.spec import Distribution, LinkSpec

TOLERANCE = 0.05
"""Share of the requested mean by which keeping order or clamping may move it without a warning."""
EVENT_RATE = 0.2
"""Taken for topics without a rate [Hz]."""

_RUNS = 8
_ARRIVALS = 8000
_MOST_ARRIVALS = 64_000
_TIME_CONSTANTS = 400.0
"""Of a correlated jitter that are simulated; a long tail needs as many."""
_SEARCH_ARRIVALS = 16_000
"""Most that are simulated of each specification that might be proposed."""
_CORRELATIONS = (0.1, 0.2, 0.5, 1.0, 2.0, 4.0, 8.0, 15.0, 30.0)
"""Time constants that may be proposed [s]."""


@dataclass(frozen=True)
class Figures:
    """Of delays [s]."""

    mean: float
    sd: float
    p50: float
    p99: float


@dataclass(frozen=True)
class Prediction:
    """What will come of a specification.

    Attributes:
        spec: what was asked for.
        rate: of the messages [Hz].
        requested: figures of the distribution as written.
        predicted: figures of what the consumer will see.
        clamping: what draws below 0, counted as 0, add to the mean [s].
        ordering: what waiting for earlier messages adds to it [s].
        uncertainty: standard error of that [s].
        clamped: share of the draws below 0.
        held_back: share of the messages that wait for an earlier one.
        lost: share that is lost.
        delays: simulated [s].
    """

    spec: LinkSpec
    rate: float
    requested: Figures
    predicted: Figures
    clamping: float
    ordering: float
    uncertainty: float
    clamped: float
    held_back: float
    lost: float
    delays: tuple[float, ...]

    @property
    def moved(self) -> float:
        """By how much of the requested mean the mean is moved."""
        mean = self.requested.mean
        return (self.predicted.mean - mean) / mean if mean > 0.0 else 0.0

    @property
    def faithful(self) -> bool:
        """Whether the mean may stay where it was asked to be, as far as that can be told."""
        return self._off - 2.0 * self.uncertainty <= TOLERANCE * self.requested.mean

    @property
    def surely_faithful(self) -> bool:
        """Whether it does."""
        return self._off + 2.0 * self.uncertainty <= TOLERANCE * self.requested.mean

    @property
    def _off(self) -> float:
        return abs(self.predicted.mean - self.requested.mean)


def predict(spec: LinkSpec, rate: float, arrivals: int = 0) -> Prediction:
    """Simulate a link.

    Args:
        spec: the link.
        rate: of the messages [Hz]; 0: an event topic.
        arrivals: how many to simulate; 0: some thousand, more for a correlated jitter.

    Raises:
        ConfigError: the rate is not one.
    """
    if not (math.isfinite(rate) and 0.0 <= rate <= 10_000.0):
        raise ConfigError(f"a rate of {rate:g} Hz; expected 0 (events) to 10 000")
    rate = rate or EVENT_RATE
    count = max(1, (arrivals or _enough(spec, rate)) // _RUNS)
    lines = [_run(spec, rate, count, seed) for seed in range(_RUNS)]
    added = [ordering for _, ordering, _ in lines]
    ordering = max(0.0, math.fsum(added) / _RUNS)
    clamping, clamped = _clamping(spec)
    asked = requested_figures(spec)
    delays = [delay for run, _, _ in lines for delay in run]
    seen = figures(delays)
    return Prediction(
        spec=spec,
        rate=rate,
        requested=asked,
        predicted=Figures(asked.mean + clamping + ordering, seen.sd, seen.p50, seen.p99),
        clamping=clamping,
        ordering=ordering,
        uncertainty=figures(added).sd / math.sqrt(_RUNS - 1),
        clamped=clamped,
        held_back=sum(held for _, _, held in lines) / (count * _RUNS),
        lost=spec.loss,
        delays=tuple(delays),
    )


def _run(spec: LinkSpec, rate: float, count: int, seed: int) -> tuple[list[float], float, int]:
    """Simulate ``count`` arrivals: delays [s], what order adds to their mean [s], held back."""
    # Without loss, which changes no delay: what is lost would be missing from the figures.
    kept = spec.model_copy(update={"seed": None, "loss": 0.0})
    line: DelayLine[None] = DelayLine(kept, seed)
    delays = []
    for number in range(count):
        now = round(number * 1e9 / rate)
        delays += [1e-9 * released.injected_ns for released in line.pop(now)]
        line.push(None, now)
    delays += [1e-9 * released.injected_ns for released in line.pop(2**62)]
    stats = line.stats()
    return delays, stats.achieved_mean - stats.drawn_mean, stats.held_back


def advice(prediction: Prediction) -> str:
    """A warning if the mean will not be what was asked for, with what to write; empty if it is."""
    if prediction.faithful:
        return ""
    reasons = []
    mean = prediction.requested.mean
    if prediction.clamping > 0.01 * mean:
        reasons.append(
            f"{100 * prediction.clamped:.0f} % of the draws are below 0 and count as 0 "
            f"(+{1e3 * prediction.clamping:.0f} ms)"
        )
    if prediction.ordering > 0.01 * mean:
        reasons.append(
            f"order is kept, so {100 * prediction.held_back:.0f} % of the messages wait for an "
            f"earlier one (+{1e3 * prediction.ordering:.0f} ms)"
        )
    better = alternative(prediction)
    mend = f"; write instead: {better}" if better else ""
    return (
        f"at {prediction.rate:g} Hz the mean will be {1e3 * prediction.predicted.mean:.0f} ms, not "
        f"{1e3 * mean:.0f} ms: {' and '.join(reasons)}{mend}"
    )


def alternative(prediction: Prediction) -> str:
    """Specifications with the mean that was asked for, ``a`` or ``b``; empty if none was found."""
    spec, rate = prediction.spec, prediction.rate
    if prediction.clamping > 0.01 * spec.mean and spec.sd > 0.0:
        spec = spec.model_copy(update={"distribution": Distribution.LOGNORMAL})
    found = []
    if spec.distribution is not Distribution.TRACE:
        slower = _slow_enough(spec, rate)
        if slower is not None:
            found.append(f'"{slower}"')
    free = spec.model_copy(update={"keep_order": False, "correlation": 0.0})
    if predict(free, rate).faithful:
        found.append(f'"{free}" (messages may overtake each other)')
    return " or ".join(found)


def _slow_enough(spec: LinkSpec, rate: float) -> LinkSpec | None:
    """The same delays with the fastest jitter that keeps order and mean; None: there is none."""
    tried = [
        spec.model_copy(update={"correlation": seconds, "keep_order": True})
        for seconds in _CORRELATIONS
        if seconds > spec.correlation
    ]
    # The slower, the less is held back.
    low, high = 0, len(tried)
    while low < high:
        middle = (low + high) // 2
        arrivals = min(_enough(tried[middle], rate), _SEARCH_ARRIVALS)
        if predict(tried[middle], rate, arrivals).surely_faithful:
            high = middle
        else:
            low = middle + 1
    return tried[low] if low < len(tried) else None


def figures(delays: list[float]) -> Figures:
    """Mean, standard deviation, median and 99th percentile [s]; zeros without data."""
    if not delays:
        return Figures(0.0, 0.0, 0.0, 0.0)
    ordered = sorted(delays)
    count = len(ordered)
    mean = math.fsum(ordered) / count
    sd = math.sqrt(math.fsum((delay - mean) ** 2 for delay in ordered) / count)
    return Figures(mean, sd, _quantile(ordered, 0.5), _quantile(ordered, 0.99))


def requested_figures(spec: LinkSpec) -> Figures:
    """Figures of the distribution as written [s]; for ``normal`` before clamping at 0."""
    mean, p99 = requested(spec)
    if spec.distribution is Distribution.TRACE:
        return figures(list(spec.trace))
    median = mean
    if spec.distribution is Distribution.LOGNORMAL:
        median = math.exp(lognormal_parameters(spec)[0])
    return Figures(mean, spec.sd, median, p99)


def _quantile(ordered: list[float], share: float) -> float:
    return ordered[max(0, math.ceil(share * len(ordered)) - 1)]


def _enough(spec: LinkSpec, rate: float) -> int:
    """Arrivals to simulate: whole rounds of a trace, some hundred time constants of a jitter."""
    if spec.distribution is Distribution.CONSTANT:
        return 25 * _RUNS
    if spec.distribution is Distribution.TRACE:
        rounds = -(-_ARRIVALS // (_RUNS * len(spec.trace)))
        return min(_RUNS * rounds * len(spec.trace), _MOST_ARRIVALS)
    return round(min(max(_ARRIVALS, _TIME_CONSTANTS * spec.correlation * rate), _MOST_ARRIVALS))


def _clamping(spec: LinkSpec) -> tuple[float, float]:
    """What clamping adds to the mean [s], E[max(0, X)] - E[X], and the share of draws below 0."""
    if spec.distribution is not Distribution.NORMAL or spec.sd == 0.0:
        return 0.0, 0.0
    z = spec.mean / spec.sd
    below = 0.5 * math.erfc(z / math.sqrt(2.0))
    density = math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
    return spec.sd * density - spec.mean * below, below
