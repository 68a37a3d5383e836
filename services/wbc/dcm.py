"""Divergent component of motion: from a footstep plan to CoM and DCM references.

Linear inverted pendulum of height z, w = sqrt(g / z): the DCM xi = c + cdot / w obeys
xidot = w (xi - v) with v the virtual repellent point (VRP). Given v(t) and the end condition
xi(T) = v(T), xi is integrated backwards (stable), the CoM forwards (stable). The first double
support cannot start where that backward pass ends, so it is a cubic Hermite from rest at the
CoM set-point, whose VRP follows as v = xi - xidot / w. (Takenaka et al. 2009; Englsberger 2015.)
"""

from dataclasses import dataclass
from itertools import accumulate
from math import exp, sqrt
from typing import NamedTuple

import numpy as np

from common.schemas.arrays import Float64Array as Array

GRAVITY = 9.81
GRID = 0.002
"""Spacing of the planned references [s]."""
BLOCK = 64
"""Number of grid points that are integrated at once."""
TAIL = 2.0
"""Rest appended to a plan so that the CoM has converged to the DCM when it ends [s]."""


@dataclass(frozen=True)
class DcmTiming:
    """Durations of one gait's phases [s]."""

    initial_transfer: float
    single_support: float
    double_support: float
    final_transfer: float
    settle: float


class DcmReference(NamedTuple):
    """References at one instant, horizontal (x, y) in world [m, m/s, m/s²]."""

    dcm: Array
    vrp: Array
    com: Array
    com_velocity: Array
    com_acceleration: Array


class DcmPlan:
    """References on a uniform grid; beyond its end the robot rests at the last point.

    Attributes:
        omega: natural frequency [1/s].
        dcm, vrp, com: (n, 2) in world [m], :data:`GRID` apart.
    """

    def __init__(self, omega: float, dcm: Array, vrp: Array, com: Array) -> None:
        self.omega = omega
        self.dcm, self.vrp, self.com = dcm, vrp, com
        # All of a reference in one table, so that one interpolation serves it.
        velocity, acceleration = omega * (dcm - com), omega * omega * (com - vrp)
        self._table = np.stack((dcm, vrp, com, velocity, acceleration), axis=1)

    @property
    def duration(self) -> float:
        """Planned time including the tail [s]."""
        return (len(self.dcm) - 1) * GRID

    def at(self, time: float) -> DcmReference:
        """References ``time`` seconds after the start, linear between grid points."""
        last = len(self._table) - 1
        position = min(max(time / GRID, 0.0), float(last))
        k = min(int(position), last - 1)
        share = position - k
        return DcmReference(*((1.0 - share) * self._table[k] + share * self._table[k + 1]))


def natural_frequency(com_height: float) -> float:
    """Return w = sqrt(g / z) [1/s] for a CoM ``com_height`` [m] above the soles."""
    return sqrt(GRAVITY / com_height)


def smoothstep(share: Array) -> Array:
    """Cubic ramp 0 to 1 with zero slope at both ends, for ``share`` in [0, 1]."""
    return share * share * (3.0 - 2.0 * share)


def plan_dcm(
    com: Array,
    dcm: Array,
    stances: list[Array],
    end: Array,
    timing: DcmTiming,
    omega: float,
) -> DcmPlan:
    """Plan one gait.

    Args:
        com: (2,) CoM reference when the gait starts [m]; not the measured one.
        dcm: (2,) DCM reference then, at rest [m].
        stances: the stance foot's VRP (2,) of each step, in order [m].
        end: (2,) where CoM and DCM come to rest [m].
        timing: phase durations.
        omega: :func:`natural_frequency` of the planned height.

    Returns:
        References from the start of the initial transfer to :data:`TAIL` after the settling time.
    """
    vrp, transfer = _vrp_grid(dcm, stances, end, timing)
    track = _backward_dcm(vrp, omega)
    track[: transfer + 1] = _initial_transfer(dcm, track, vrp, transfer, omega)
    slope = np.gradient(track[: transfer + 1], GRID, axis=0)
    vrp[: transfer + 1] = track[: transfer + 1] - slope / omega
    decay = exp(-omega * GRID)
    return DcmPlan(omega, track, vrp, first_order(com, (1.0 - decay) * track[:-1], decay))


def first_order(start: Array, drive: Array, decay: float) -> Array:
    """Integrate y[k + 1] = ``decay`` y[k] + ``drive``[k] from y[0] = ``start``.

    Args:
        start: (m,) first value.
        drive: (n, m) input of each interval.
        decay: factor of the previous value.

    Returns:
        (n + 1, m), what ``scipy.signal.lfilter`` computes, but for rounding. Importing that package
        would keep a restarted controller from its robot for seconds.
    """
    count, width = drive.shape
    blocks = -(-count // BLOCK)
    inputs = np.zeros((blocks * BLOCK, width))
    inputs[:count] = drive
    # Blocks are integrated side by side, each from zero; one value of each is carried to the next.
    lag = np.subtract.outer(np.arange(BLOCK), np.arange(BLOCK))
    response = np.where(lag >= 0, decay ** np.abs(lag), 0.0)
    alone = response @ inputs.reshape(blocks, BLOCK, width)
    over = decay**BLOCK
    carried = [
        list(accumulate(ends, lambda y, u: over * y + u, initial=first))
        for first, ends in zip(start.tolist(), alone[:, -1].T.tolist(), strict=True)
    ]
    begun = np.array(carried).T[:-1, None]
    result = alone + (decay ** np.arange(1, BLOCK + 1))[:, None] * begun
    return np.vstack((start, result.reshape(-1, width)[:count]))


def _vrp_grid(
    start: Array, stances: list[Array], end: Array, timing: DcmTiming
) -> tuple[Array, int]:
    def samples(duration: float) -> int:
        return max(1, round(duration / GRID))

    def blend(a: Array, b: Array, duration: float) -> Array:
        share = smoothstep(np.arange(samples(duration)) / samples(duration))[:, None]
        result: Array = (1.0 - share) * a + share * b
        return result

    parts = [blend(start, stances[0], timing.initial_transfer)]
    for index, stance in enumerate(stances):
        parts.append(np.tile(stance, (samples(timing.single_support), 1)))
        last = index == len(stances) - 1
        target = end if last else stances[index + 1]
        parts.append(
            blend(stance, target, timing.final_transfer if last else timing.double_support)
        )
    parts.append(np.tile(end, (samples(timing.settle + TAIL) + 1, 1)))
    return np.concatenate(parts), samples(timing.initial_transfer)


def _backward_dcm(vrp: Array, omega: float) -> Array:
    decay = exp(-omega * GRID)
    # At its end the DCM rests on the VRP.
    drive = (1.0 - decay) * vrp[::-1]
    result: Array = first_order(decay * vrp[-1] + drive[0], drive[1:], decay)[::-1].copy()
    return result


def _initial_transfer(start: Array, dcm: Array, vrp: Array, count: int, omega: float) -> Array:
    duration = count * GRID
    end, slope = dcm[count], omega * (dcm[count] - vrp[count])
    s = (np.arange(count + 1) / count)[:, None]
    h00 = 1.0 - smoothstep(s)
    h11 = s * s * (s - 1.0)
    result: Array = h00 * start + (1.0 - h00) * end + h11 * duration * slope
    return result
