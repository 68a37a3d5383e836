"""Delay line: a link with latency, jitter and loss, as a pure object without a clock.

:meth:`common.inbox.arrivals.ArrivalQueue.release` passes the messages of an input through its delay
line; messages are held back there and nowhere else.

Model. Message k arrives at the line at time t_k. It is lost with probability ``loss``; else it
draws a delay d_k >= 0 (negative draws become 0) and falls due at t_k + d_k. With ``keep_order``
(a link over a reliable, ordered transport) it falls due no earlier than the message before it:

    due_k = max(t_k + d_k, due_{k-1})

Holding back for order can only add delay. With independent draws whose spread is wide compared
with the message interval this raises the mean well above the requested one (250 ms with a
standard deviation of 20 ms at 500 Hz has a mean near 274 ms). Two remedies: ``order=free``,
where a late message may be overtaken, or ``corr=<time constant>``, which draws the delays from
an autocorrelated process with the same distribution, as congestion on a real link is.
:meth:`DelayLine.stats` gives requested, drawn and achieved figures.

Distributions: ``constant``; ``normal`` (mean, standard deviation, clamped at 0); ``lognormal``
(parametrised by the mean and standard deviation of the delay itself, so sigma² =
ln(1 + sd²/mean²), mu = ln mean - sigma²/2); ``trace`` (recorded delays one after the other,
starting over at the end). The correlated latent Gaussian is an Ornstein-Uhlenbeck process
sampled at the arrivals: g_k = r g_{k-1} + sqrt(1 - r²) n_k with r = exp(-(t_k - t_{k-1}) / tau).

The two lines of a stereo pair draw ``by_time``: delay and loss of a frame depend on the seed and
its capture time only (see :mod:`common.links.samplers`), so both pictures of a frame share them.
The entry of a trace is then chosen by the capture time as well, in steps of ``frame_ns``.
"""

import heapq
import math
from array import array
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from common.links.samplers import SequentialSampler, TimeSampler
from common.links.spec import Distribution, LinkSpec
from common.links.summary import lognormal_parameters, requested

T = TypeVar("T")

_NEVER = 2**63
_ACHIEVED_KEPT = 10_000


class Released(NamedTuple, Generic[T]):
    """An item that left a :class:`DelayLine`."""

    due_ns: int
    """When it was due [ns]."""
    injected_ns: int
    """How long the line held it [ns]."""
    item: T


@dataclass(frozen=True)
class DelayStats:
    """Requested and achieved delays of one link; durations in seconds.

    ``drawn_mean`` differs from ``requested_mean`` by clamping at 0 and by chance;
    ``achieved_mean`` differs from ``drawn_mean`` by holding messages back to keep their order.
    ``achieved_p99`` is over the last 10 000 messages. Figures without data are 0.
    """

    requested_mean: float
    requested_p99: float
    drawn_mean: float
    achieved_mean: float
    achieved_p99: float
    pushed: int
    lost: int
    held_back: int


class DelayLine(Generic[T]):
    """Holds items for a time drawn from a :class:`LinkSpec`; deterministic for a given seed.

    Not thread-safe. All times are of one monotonic clock [ns].
    """

    def __init__(self, spec: LinkSpec, seed: int = 0, frame_ns: int | None = None) -> None:
        """Create an empty line.

        Args:
            spec: delay, jitter and loss.
            seed: seed of the draws, unless the specification has its own.
            frame_ns: time between frames of a stereo pair, whose two lines delay alike [ns]; None:
                an input by itself.
        """
        self.spec = spec
        self.by_time = frame_ns is not None
        """Whether :meth:`push` draws by the time of capture."""
        self._frame_ns = frame_ns or 1
        chosen = spec.seed if spec.seed is not None else seed
        self._sampler = TimeSampler(chosen) if self.by_time else SequentialSampler(chosen)
        self._heap: list[tuple[int, int, int, T]] = []
        self._count = 0
        self._last_due = 0
        self._drawn = 0
        self._lost = 0
        self._held_back = 0
        self._released = 0
        self._achieved_sum = 0
        self._achieved = array("q")
        """A ring of the latest, so that their percentile costs a control loop microseconds."""
        self._requested = requested(spec)
        certain = spec.distribution is Distribution.CONSTANT and not spec.loss
        self._certain_ns = round(spec.mean * 1e9) if certain else None
        """Delay of every message, if chance has no part in it [ns]."""

    @property
    def next_due_ns(self) -> int:
        """When the next item falls due [ns]; a time out of reach if the line is empty."""
        return self._heap[0][0] if self._heap else _NEVER

    def __len__(self) -> int:
        return len(self._heap)

    def push(self, item: T, now_ns: int, captured_ns: int | None = None) -> bool:
        """Put in an item that arrived at ``now_ns``; False if the link loses it.

        A line ``by_time`` draws by ``captured_ns``; None: by the time of arrival.
        """
        number = self._count
        self._count += 1
        delay = self._certain_ns
        if delay is None:
            at_ns = captured_ns if self.by_time and captured_ns is not None else now_ns
            delay = self._draw(at_ns // self._frame_ns if self.by_time else number, at_ns)
            if self._sampler.lost(at_ns, self.spec.loss):
                self._lost += 1
                return False
        self._drawn += delay
        due = now_ns + delay
        if self.spec.keep_order:
            if due < self._last_due:
                due = self._last_due
                self._held_back += 1
            self._last_due = due
        heapq.heappush(self._heap, (due, number, now_ns, item))
        return True

    def adopt(self, other: "DelayLine[T]") -> None:
        """Take over the items that ``other`` still holds, with their due times.

        The statistics of this line do not count them. With ``keep_order`` nothing pushed later
        comes out before them.
        """
        held = [
            (due, number - other._count, pushed, item) for due, number, pushed, item in other._heap
        ]
        self._heap += held
        heapq.heapify(self._heap)
        other._heap = []
        self._last_due = max([self._last_due, *(due for due, *_ in held)])

    def pop(self, now_ns: int) -> list[Released[T]]:
        """Take out every item due by ``now_ns``, in the order of the due times."""
        released = []
        heap = self._heap
        while heap and heap[0][0] <= now_ns:
            due, number, pushed, item = heapq.heappop(heap)
            injected = due - pushed
            released.append(Released(due, injected, item))
            if number >= 0:  # negative numbers are adopted from another line
                if len(self._achieved) < _ACHIEVED_KEPT:
                    self._achieved.append(injected)
                else:
                    self._achieved[self._released % _ACHIEVED_KEPT] = injected
                self._released += 1
                self._achieved_sum += injected
        return released

    def stats(self) -> DelayStats:
        """Return requested and achieved figures so far."""
        kept = self._count - self._lost
        count = len(self._achieved)
        rank = math.ceil(0.99 * count) - 1
        # A copy, since a view would keep the ring from growing.
        achieved = np.array(self._achieved, np.int64)
        p99 = int(np.partition(achieved, rank)[rank]) if count else 0
        return DelayStats(
            requested_mean=self._requested.mean,
            requested_p99=self._requested.p99,
            drawn_mean=1e-9 * self._drawn / kept if kept else 0.0,
            achieved_mean=1e-9 * self._achieved_sum / self._released if self._released else 0.0,
            achieved_p99=1e-9 * p99,
            pushed=self._count,
            lost=self._lost,
            held_back=self._held_back,
        )

    def _draw(self, number: int, at_ns: int) -> int:
        """Draw the delay of message ``number``, arrived or captured at ``at_ns`` [ns]."""
        spec = self.spec
        if spec.distribution is Distribution.CONSTANT:
            seconds = spec.mean
        elif spec.distribution is Distribution.TRACE:
            seconds = spec.trace[number % len(spec.trace)]
        else:
            gauss = self._sampler.gauss(at_ns, spec.correlation)
            if spec.distribution is Distribution.NORMAL:
                seconds = max(0.0, spec.mean + spec.sd * gauss)
            else:
                mu, sigma = lognormal_parameters(spec)
                seconds = math.exp(mu + sigma * gauss)
        return round(seconds * 1e9)
