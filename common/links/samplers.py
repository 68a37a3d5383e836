"""Random numbers for the messages of one link.

An ordinary link draws one number after the other (:class:`SequentialSampler`). The two cameras of a
stereo pair are two inputs that stand for one link: their delay lines must decide alike about the
same frame, also if one of them missed a frame before or was set up later. There each number is a
function of the seed and the frame's capture time alone (:class:`TimeSampler`).
"""

import math
import random
from collections import deque

_CELLS_PER_TAU = 16
_MEMORY = 96
"""Cells of noise in a correlated value: six time constants."""


class SequentialSampler:
    """Draws one message after the other; correlated ones are an Ornstein-Uhlenbeck process."""

    def __init__(self, seed: int) -> None:
        """Seed delays and losses separately, so that another loss leaves the delays as they are."""
        self._delays = random.Random(f"delay {seed}")
        self._losses = random.Random(f"loss {seed}")
        self._latent: float | None = None
        self._at_ns = 0

    def gauss(self, time_ns: int, tau: float) -> float:
        """Draw a standard normal number for the next message.

        It arrived, or was captured, at ``time_ns``. ``tau`` is the time constant of the
        correlation [s]; 0 gives independent numbers.
        """
        fresh = self._delays.gauss(0.0, 1.0)
        if tau > 0.0 and self._latent is not None:
            r = math.exp(-1e-9 * max(0, time_ns - self._at_ns) / tau)
            fresh = r * self._latent + math.sqrt(1.0 - r * r) * fresh
        self._latent = fresh
        self._at_ns = time_ns
        return fresh

    def lost(self, time_ns: int, probability: float) -> bool:
        """Decide whether the next message is lost."""
        del time_ns
        return probability > 0.0 and self._losses.random() < probability


class TimeSampler:
    """Draws by capture time: the same seed and time give the same number, whatever came before.

    Correlated numbers are a moving average of white noise on a grid of a sixteenth of the time
    constant, with weights that fall off exponentially: the same correlation as
    :class:`SequentialSampler` at the points of the grid, constant between them.
    """

    def __init__(self, seed: int) -> None:
        """Create a sampler, which keeps only the noise that may be needed again."""
        self._seed = seed
        decay = math.exp(-1.0 / _CELLS_PER_TAU)
        scale = math.sqrt((1.0 - decay**2) / (1.0 - decay ** (2 * _MEMORY)))
        self._weights = [scale * decay**age for age in range(_MEMORY)]
        self._noise: deque[float] = deque(maxlen=_MEMORY)
        """The noise of the newest cell comes first."""
        self._cell: int | None = None

    def gauss(self, time_ns: int, tau: float) -> float:
        """Draw a standard normal number, as :meth:`SequentialSampler.gauss` does."""
        if tau <= 0.0:
            return self._generator("delay", time_ns).gauss(0.0, 1.0)
        cell = time_ns * _CELLS_PER_TAU // max(1, round(1e9 * tau))
        first = cell - _MEMORY + 1
        if self._cell is None or not self._cell <= cell <= self._cell + _MEMORY:
            self._noise.clear()
        elif self._cell >= first:
            first = self._cell + 1
        for number in range(first, cell + 1):
            self._noise.appendleft(self._generator("cell", number).gauss(0.0, 1.0))
        self._cell = cell
        return math.fsum(w * n for w, n in zip(self._weights, self._noise, strict=True))

    def lost(self, time_ns: int, probability: float) -> bool:
        """Decide whether the message of that time is lost."""
        return probability > 0.0 and self._generator("loss", time_ns).random() < probability

    def _generator(self, kind: str, number: int) -> random.Random:
        return random.Random(f"{kind} {self._seed} {number}")
