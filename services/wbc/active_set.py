"""Solves a QP by the guess that the rows that bind are those that bound the last one.

With the binding rows known, the QP's optimality conditions are linear equations. At most ticks the
guess is right at once (mostly no inequality binds at all). Otherwise rows that are violated are
added to it and rows that only hold back are dropped, a few times: a primal-dual active-set method
(Hintermüller, Ito, Kunisch 2002). A solution found so is exact: every row holds and every
multiplier has the right sign. Where none is found, a QP solver is asked.
"""

from typing import NamedTuple

import eigenpy
import numpy as np
from numpy.typing import NDArray

from common.schemas.arrays import Float64Array as Array
from services.wbc.layout import NV
from services.wbc.qp import BOUNDS, CONES, INFINITY, NORMAL, NUM_VARIABLES, TORQUE, QpData
from services.wbc.solvers import EQUALITIES, SLACK_WEIGHT, Solution, Solver

Indices = NDArray[np.intp]
GUESSES = 5
"""Largest number of guesses for one QP; in walking one tick of twenty needs a second."""
TOLERANCE = 1e-7
"""Violation up to which a row holds [N, N·m, m/s²]."""
NO_PRESSURE = 1e-10
"""Multiplier up to which its sign does not matter: by the weight of the forces, 5e-5 N."""
FIRST = NUM_VARIABLES + EQUALITIES
"""Place of the first inequality's multiplier among the unknowns."""
MET = 1e-5
"""Distance from its bound at which a row of a solver's solution is taken to bind."""
_RIGHT_CONE = (CONES.start + CONES.stop) // 2
GROUPS = (
    TORQUE,
    slice(CONES.start, _RIGHT_CONE),
    slice(_RIGHT_CONE, CONES.stop),
    slice(NORMAL.start, BOUNDS.stop),
)
"""Of the violated rows of each group only the worst is added at once, for the rows of a cone are
more than a wrench has components and so depend on each other."""


class _Guess(NamedTuple):
    """Rows that are taken to bind besides the equalities, which always do.

    Attributes:
        rows: (k,) indices into A.
        sides: (k,) which bound: -1 lower, 1 upper.
        soft: (m,) indices into B.
    """

    rows: Indices
    sides: Array
    soft: Indices

    def bounds(self, data: QpData) -> Array:
        """Return the bounds (k,) that bind."""
        return np.where(self.sides > 0.0, data.u[self.rows], data.l[self.rows])

    def still_there(self, data: QpData) -> "_Guess":
        """Return the guess without the rows that are gone or no longer bounded."""
        bounded = np.abs(self.bounds(data)) < INFINITY
        return _Guess(self.rows[bounded], self.sides[bounded], self.soft[self.soft < len(data.b)])


_NO_ROWS = np.zeros(0, dtype=np.intp)
_NOTHING = _Guess(_NO_ROWS, np.zeros(0), _NO_ROWS)
"""No inequality binds: the common case, in which most of the work can be left out."""


class ActiveSet:
    """A solver that first guesses the rows that bind, and asks another where that fails.

    Args:
        inner: the other solver.

    Attributes:
        name: of the other solver.
        asked: number of QPs that were left to it.
    """

    def __init__(self, inner: Solver) -> None:
        self.name = inner.name
        self.asked = 0
        self._inner = inner
        self._guess = _NOTHING
        # Matrix and right side of the optimality conditions of the largest guess.
        self._matrix = np.zeros((2 * NUM_VARIABLES, 2 * NUM_VARIABLES))
        self._right = np.zeros(2 * NUM_VARIABLES)
        n = NUM_VARIABLES
        self._cost, self._down = self._matrix[:n, :n], self._right[:n]
        self._equal, self._equal_right = self._matrix[n:FIRST, :n], self._right[n:FIRST]
        self._equal_transposed = self._matrix[:n, n:FIRST]

    def solve(self, data: QpData) -> Solution:
        """Solve one QP, starting from the rows that bound the last."""
        guess = self._guess if self._guess is _NOTHING else self._guess.still_there(data)
        for _ in range(GUESSES):
            if FIRST + len(guess.rows) + len(guess.soft) > len(self._right):
                break
            x, multipliers = self._optimum(data, guess)
            better = _corrected(data, guess, x, multipliers)
            if better is guess:
                count = len(guess.rows) + len(guess.soft)
                self._guess = guess if count else _NOTHING
                return Solution(x, True, f"{count} rows bind")
            guess = better
        self.asked += 1
        solution = self._inner.solve(data)
        self._guess = _met(data, solution.x) if solution.solved else _NOTHING
        return solution

    def _optimum(self, data: QpData, guess: _Guess) -> tuple[Array, Array]:
        """Return minimiser (43,) and multipliers (k + m,) if just the rows of a guess bind.

        A multiplier is positive where the row presses downwards, negative where upwards. Where rows
        depend on each other, numbers are not finite, or do not satisfy the rows.
        """
        n, matrix, right = NUM_VARIABLES, self._matrix, self._right
        self._cost[:] = data.P
        self._equal[:] = equal = data.A[:EQUALITIES]
        self._equal_transposed[:] = equal.T
        np.negative(data.q, out=self._down)
        self._equal_right[:] = data.l[:EQUALITIES]
        size = FIRST
        if guess is not _NOTHING:
            rows, _, soft = guess
            end, size = FIRST + len(rows), FIRST + len(rows) + len(soft)
            matrix[FIRST:end, :n], right[FIRST:end] = data.A[rows], guess.bounds(data)
            matrix[end:size, :NV], right[end:size] = data.B[soft], data.b[soft]
            matrix[end:size, NV:n] = 0.0
            matrix[:n, FIRST:size] = matrix[FIRST:size, :n].T
            matrix[n:size, FIRST:size] = matrix[FIRST:size, n:FIRST] = 0.0
            slack = np.arange(end, size)
            matrix[slack, slack] = -1.0 / SLACK_WEIGHT
        # Eigen's LU rather than LAPACK's: less code, and a tick starts with cold caches.
        solution = eigenpy.PartialPivLU(matrix[:size, :size]).solve(right[:size])
        return solution[:n], solution[FIRST:]


def _met(data: QpData, x: Array) -> _Guess:
    """Return the rows that a solver's solution meets with equality."""
    values = data.A.dot(x)
    below, above = (np.abs(values - bound) < MET for bound in (data.l, data.u))
    below[:EQUALITIES] = above[:EQUALITIES] = False
    rows = np.flatnonzero(below | above)
    soft = np.flatnonzero(data.b - data.B.dot(x[:NV]) > TOLERANCE)
    return _Guess(rows, np.where(above[rows], 1.0, -1.0), soft)


def _corrected(data: QpData, guess: _Guess, x: Array, multipliers: Array) -> _Guess:
    """Return the next guess; this one if it was right."""
    values = data.A.dot(x)
    excess = np.maximum(data.l - values, values - data.u)
    # Not so if a number is not finite, for then no comparison holds.
    holds = excess[excess.argmax()] <= TOLERANCE
    if guess is _NOTHING and holds and not len(data.b):
        return guess
    rows, sides, soft = guess
    pressing = sides * multipliers[: len(rows)] >= -NO_PRESSURE
    # Of the soft rows just those bind that are violated.
    missed = data.b - data.B.dot(x[:NV]) > TOLERANCE
    missed[soft] = multipliers[len(rows) :] <= NO_PRESSURE
    violated = np.flatnonzero(missed)
    if holds and pressing.all() and np.array_equal(violated, soft):
        return guess
    worst = [group.start + int(excess[group].argmax()) for group in GROUPS]
    added = [row for row in worst if not excess[row] <= TOLERANCE and row not in rows]
    sides_added = np.where(values[added] < data.l[added], -1.0, 1.0)
    return _Guess(
        np.concatenate((rows[pressing], np.array(added, dtype=rows.dtype))),
        np.concatenate((sides[pressing], sides_added)),
        violated,
    )
