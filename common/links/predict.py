"""Predict the delays that a link specification yields at a message rate.

Pure: seeded simulations through the same :class:`~common.links.delay.DelayLine` that delays the
messages, with arrivals at even intervals. The predicted mean is the requested one, plus what
clamping at 0 adds (known exactly), plus what keeping the order adds (simulated, against the same
draws), so that little of it is the chance of a finite simulation. Several simulations with
different seeds tell how much is.
"""

import math
from dataclasses import dataclass

from common.errors import ConfigError
from common.links.delay import DelayLine
from common.links.spec import Distribution, LinkSpec
from common.links.summary import DelaySummary, requested, summarize

TOLERANCE = 0.05
"""Share of the requested mean by which keeping order or clamping may move it without a warning."""
EVENT_RATE = 0.2
"""Rate assumed for topics without a nominal rate [Hz]."""

_RUNS = 8
_ARRIVALS = 8000
_MOST_ARRIVALS = 64_000
_TIME_CONSTANTS = 400.0
"""Simulated duration of a correlated jitter, in its time constants; a long tail needs as many."""


@dataclass(frozen=True)
class Prediction:
    """The delays to expect of a specification; durations in seconds.

    Attributes:
        spec: the specification.
        rate: messages per second.
        requested: the distribution as written.
        predicted: the delays that the consumer will see.
        clamping: added to the mean by draws below 0, which count as 0.
        ordering: added to the mean by waiting for earlier messages.
        uncertainty: standard error of ``ordering``.
        clamped: share of the draws below 0.
        held_back: share of the messages that wait for an earlier one.
        delays: the simulated delays.
    """

    spec: LinkSpec
    rate: float
    requested: DelaySummary
    predicted: DelaySummary
    clamping: float
    ordering: float
    uncertainty: float
    clamped: float
    held_back: float
    delays: tuple[float, ...]

    @property
    def shift(self) -> float:
        """Change of the mean as a share of the requested one."""
        mean = self.requested.mean
        return (self.predicted.mean - mean) / mean if mean > 0.0 else 0.0

    @property
    def faithful(self) -> bool:
        """Whether the mean stays where it was requested, as far as the simulation can tell."""
        shift = abs(self.predicted.mean - self.requested.mean)
        return shift - 2.0 * self.uncertainty <= TOLERANCE * self.requested.mean

    @property
    def warning(self) -> str:
        """A text on why the mean will not be the requested one; empty if it will be."""
        if self.faithful:
            return ""
        mean = self.requested.mean
        reasons, remedies = [], []
        if self.clamping > 0.01 * mean:
            reasons.append(
                f"{100 * self.clamped:.0f} % of the draws are below 0 and count as 0 "
                f"(+{1e3 * self.clamping:.0f} ms)"
            )
            remedies.append("lognormal has no draws below 0")
        if self.ordering > 0.01 * mean:
            reasons.append(
                f"order is kept, so {100 * self.held_back:.0f} % of the messages wait for an "
                f"earlier one (+{1e3 * self.ordering:.0f} ms)"
            )
            remedies.append("order=free lets messages overtake each other")
            remedies.append("a longer corr=TIME makes the delay change slowly")
        return (
            f"at {self.rate:g} Hz the mean will be {1e3 * self.predicted.mean:.0f} ms, not "
            f"{1e3 * mean:.0f} ms (p99 {1e3 * self.predicted.p99:.0f} ms, not "
            f"{1e3 * self.requested.p99:.0f} ms): {' and '.join(reasons)}. Remedies: "
            f"{', '.join(remedies)}"
        )


def predict(spec: LinkSpec, rate: float, arrivals: int = 0) -> Prediction:
    """Simulate a link.

    Args:
        spec: the link.
        rate: messages per second; 0: an event topic, taken as :data:`EVENT_RATE`.
        arrivals: how many to simulate; 0: some thousand, more for a correlated jitter.

    Raises:
        ConfigError: the rate is out of range.
    """
    if not (math.isfinite(rate) and 0.0 <= rate <= 10_000.0):
        raise ConfigError(f"a rate of {rate:g} Hz; expected 0 (events) to 10 000")
    rate = rate or EVENT_RATE
    count = max(1, (arrivals or _arrivals(spec, rate)) // _RUNS)
    runs = [_simulate(spec, rate, count, seed) for seed in range(_RUNS)]
    added = summarize([ordering for _, ordering, _ in runs])
    ordering = max(0.0, added.mean)
    clamping, clamped = _clamping(spec)
    asked = requested(spec)
    delays = tuple(delay for run, _, _ in runs for delay in run)
    return Prediction(
        spec=spec,
        rate=rate,
        requested=asked,
        predicted=summarize(delays)._replace(mean=asked.mean + clamping + ordering),
        clamping=clamping,
        ordering=ordering,
        uncertainty=added.sd / math.sqrt(_RUNS - 1),
        clamped=clamped,
        held_back=sum(held for _, _, held in runs) / (count * _RUNS),
        delays=delays,
    )


def _simulate(spec: LinkSpec, rate: float, count: int, seed: int) -> tuple[list[float], float, int]:
    """Simulate ``count`` arrivals: delays [s], what order adds to their mean [s], held back."""
    # Loss changes no delay, but would leave fewer of them to look at.
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


def _arrivals(spec: LinkSpec, rate: float) -> int:
    """Arrivals to simulate: whole rounds of a trace, some hundred time constants of a jitter."""
    if spec.distribution is Distribution.CONSTANT:
        return 25 * _RUNS
    if spec.distribution is Distribution.TRACE:
        rounds = -(-_ARRIVALS // (_RUNS * len(spec.trace)))
        return min(_RUNS * rounds * len(spec.trace), _MOST_ARRIVALS)
    return round(min(max(_ARRIVALS, _TIME_CONSTANTS * spec.correlation * rate), _MOST_ARRIVALS))


def _clamping(spec: LinkSpec) -> tuple[float, float]:
    """Return what clamping adds to the mean, E[max(0, X)] - E[X] [s], and the share below 0."""
    if spec.distribution is not Distribution.NORMAL or spec.sd == 0.0:
        return 0.0, 0.0
    z = spec.mean / spec.sd
    below = 0.5 * math.erfc(z / math.sqrt(2.0))
    density = math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
    return spec.sd * density - spec.mean * below, below
