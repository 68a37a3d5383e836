"""QP solvers of other packages: OSQP (default), and DAQP and quadprog, which are exact.

OSQP starts from the last solution, the exact solvers start cold. The soft rows, whose number
varies, are for the exact ones: OSQP leaves a QP to DAQP where its own solution misses one of them.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from common.schemas.arrays import Float64Array as Array
from services.wbc.errors import SolverUnavailableError
from services.wbc.layout import NV
from services.wbc.qp import BOUNDS, INFINITY, NUM_CONSTRAINTS, NUM_VARIABLES, QpData

EQUALITIES = 6
"""Number of equalities, the first rows of A."""


@dataclass(frozen=True)
class Solution:
    """Result of one solve.

    Attributes:
        x: (43,) solution; valid only if ``solved``.
        solved: whether there is a solution.
        status: of the solver.
    """

    x: Array
    solved: bool
    status: str


class Solver(Protocol):
    """Solves :class:`QpData` of the fixed layout."""

    name: str

    def solve(self, data: QpData) -> Solution:
        """Solve one QP; a QP without a solution is reported in the result, not raised."""
        ...


def _held(data: QpData, x: Array, status: str) -> Solution:
    """Return a solver's answer; it is a solution only if it satisfies every constraint."""
    rows = data.A @ x
    violation = np.maximum(data.l - rows, rows - data.u).max()
    # Not so if a number is not finite, for then no comparison holds.
    return Solution(x, bool(violation <= FEASIBLE), status)


def _pattern() -> tuple[Array, Array]:
    """Return the nonzero patterns of P (upper triangle) and A, valid in every configuration."""
    P = np.zeros((NUM_VARIABLES, NUM_VARIABLES))
    P[:NV, :NV] = np.triu(np.ones((NV, NV)))
    P[range(NV, NUM_VARIABLES), range(NV, NUM_VARIABLES)] = 1.0
    # Motor coordinates by limb: left leg 6, right leg 6, left arm 6, right arm 6, neck.
    limbs = [range(6, 12), range(12, 18), range(18, 24), range(24, 30), range(30, 31)]
    A = np.zeros((NUM_CONSTRAINTS, NUM_VARIABLES))
    A[:6, :NV] = A[:NV, :6] = 1.0
    for limb in limbs:
        A[limb.start : limb.stop, limb.start : limb.stop] = 1.0
    for side, columns in enumerate((slice(NV, NV + 6), slice(NV + 6, NV + 12))):
        A[:6, columns] = 1.0
        A[limbs[side].start : limbs[side].stop, columns] = 1.0
    return P, A


SLACK_WEIGHT = 1e6
"""Weight of a soft row's violation in the cost; the hands have 20."""
SHORTFALL = 0.01
"""Deviation within which a soft row counts as met, and as binding [m/s²]."""
_SOLVED = (1, 2)
_OUT_OF_ITERATIONS = 7
"""Status values of OSQP: solved (exactly or inaccurately); maximum iterations reached."""
FEASIBLE = 5e-3
"""Largest constraint violation of a solution that is used [N, N·m]: what OSQP's relative tolerance
allows in rows of 1000 N. "Solved inaccurate" was seen to violate three times as much."""
FORCE_SCALE = 100.0
"""Unit of the reaction forces inside OSQP [N]."""


class OsqpSolver:
    """OSQP with a persistent workspace, fixed sparsity and warm start.

    Variables are scaled as x = D y: accelerations by their curvature, forces to 100 N. OSQP's own
    equilibration, recomputed at every update, left the force block so badly conditioned that one
    walking tick in a hundred ran out of iterations. With arms at their joint limits it still needs
    hundreds, 10 ms. They are therefore limited, and ``fallback``, if given, solves what it did not
    finish, and what it solved without the soft rows to a solution that misses one of them.
    """

    name = "osqp"

    def __init__(
        self, tolerance: float = 5e-6, max_iterations: int = 150, fallback: "Solver | None" = None
    ) -> None:
        try:
            import osqp
            from scipy import sparse
        except ImportError as error:
            raise SolverUnavailableError(
                "solver 'osqp' is not installed; pip install osqp scipy, or choose solver daqp"
            ) from error
        self._osqp, self._csc_matrix = osqp, sparse.csc_matrix
        self._tolerance = tolerance
        self._max_iterations = max_iterations
        self._fallback = fallback
        self._solver: Any = None
        self._soft_rows_bind = False
        # Indices of P's and A's nonzeros in the flattened matrices.
        self._P_places = self._A_places = np.ones(0, dtype=np.intp)
        self._scale = self._P_scale = self._A_scale = np.ones(0)

    def _setup(self, data: QpData) -> None:
        P_mask, A_mask = _pattern()
        # Constant rows (cones, bounds) keep the pattern of their values.
        A_mask[NV:] = data.A[NV:] != 0.0
        P_rows, P_columns = _csc_index(P_mask)
        A_rows, A_columns = _csc_index(A_mask)
        self._P_places = np.ravel_multi_index((P_rows, P_columns), P_mask.shape)
        self._A_places = np.ravel_multi_index((A_rows, A_columns), A_mask.shape)
        scale = np.minimum(1.0 / np.sqrt(data.P.diagonal()), 10.0)
        scale[NV:] = FORCE_SCALE
        self._scale = scale
        self._P_scale = scale[P_rows] * scale[P_columns]
        self._A_scale = scale[A_columns]
        P = self._csc(P_mask, self._P_scale * data.P.take(self._P_places))
        A = self._csc(A_mask, self._A_scale * data.A.take(self._A_places))
        self._solver = self._osqp.OSQP()
        self._solver.setup(
            P,
            scale * data.q,
            A,
            data.l,
            data.u,
            verbose=False,
            eps_abs=self._tolerance,
            eps_rel=self._tolerance,
            max_iter=self._max_iterations,
            warm_starting=True,
            polishing=False,
            rho=1e-5,
            scaling=0,
            check_termination=5,
            adaptive_rho=True,
            adaptive_rho_interval=100,
        )

    def _csc(self, mask: Array, values: Array) -> Any:
        rows, _ = _csc_index(mask)
        pointers = np.concatenate(([0], np.cumsum(mask.astype(bool).sum(axis=0))))
        return self._csc_matrix((values, rows, pointers), shape=mask.shape)

    def solve(self, data: QpData) -> Solution:
        """Solve from the last solution with updated values."""
        if self._soft_rows_bind and self._fallback is not None:
            # They mostly do for many ticks on end.
            return self._solve_exactly(data, self._fallback, "soft rows")
        if self._solver is None:
            self._setup(data)
        else:
            self._solver.update(
                q=self._scale * data.q,
                l=data.l,
                u=data.u,
                Px=self._P_scale * data.P.take(self._P_places),
                Ax=self._A_scale * data.A.take(self._A_places),
            )
        result = self._solver.solve(raise_error=False)
        info = result.info
        status, finite = int(info.status_val), bool(np.isfinite(result.x).all())
        iterated = finite and status in (*_SOLVED, _OUT_OF_ITERATIONS)
        if iterated:
            solution = _held(data, self._scale * result.x, str(info.status))
            kept = status in _SOLVED and data.shortfall(solution.x) < SHORTFALL
            if solution.solved and (kept or self._fallback is None):
                return solution
        else:
            # A diverged workspace would spoil the next warm start.
            self._solver = None
        if self._fallback is not None:
            return self._solve_exactly(data, self._fallback, str(info.status))
        return Solution(self._scale * result.x, False, str(info.status))

    def _solve_exactly(self, data: QpData, fallback: "Solver", status: str) -> Solution:
        """Solve exactly what OSQP did not, and warm-start OSQP from the solution."""
        exact = fallback.solve(data)
        self._soft_rows_bind = exact.solved and data.shortfall(exact.x) > -SHORTFALL
        if not exact.solved:
            # Without a solution there is no warm start.
            self._solver = None
        elif self._solver is not None:
            self._solver.warm_start(x=exact.x / self._scale)
        return Solution(exact.x, exact.solved, f"{status}; {fallback.name}: {exact.status}")


def _csc_index(mask: Array) -> tuple[Any, Any]:
    """Return the row and column indices of a mask's nonzeros in column-major (CSC) order."""
    columns, rows = np.nonzero(mask.T)
    return rows, columns


_EQUALITY, _SOFT = 5, 8
"""DAQP's senses of rows: active and immutable; soft."""
_DAQP_SOLVED = (1, 2)
"""DAQP's exits: solved, or solved with soft rows violated."""


class DaqpSolver:
    """DAQP, a dense dual active-set method: exact, about three times faster than OSQP here."""

    name = "daqp"

    def __init__(self) -> None:
        try:
            import daqp
        except ImportError as error:
            raise SolverUnavailableError(
                "solver 'daqp' is not installed; pip install daqp, or choose solver osqp"
            ) from error
        self._daqp = daqp

    def solve(self, data: QpData) -> Solution:
        """Solve from scratch."""
        # DAQP takes bounds on all variables first, then the general rows.
        count = len(data.b)
        lower = np.full(NUM_VARIABLES, -1e30), data.l[: BOUNDS.start], data.b
        upper = np.full(NUM_VARIABLES, 1e30), data.u[: BOUNDS.start], np.full(count, 1e30)
        lower[0][6:NV], upper[0][6:NV] = data.l[BOUNDS], data.u[BOUNDS]
        sense = np.zeros(NUM_VARIABLES + BOUNDS.start + count, dtype=np.intc)
        sense[NUM_VARIABLES : NUM_VARIABLES + EQUALITIES] = _EQUALITY
        sense[NUM_VARIABLES + BOUNDS.start :] = _SOFT
        rows = np.zeros((BOUNDS.start + count, NUM_VARIABLES))
        rows[: BOUNDS.start], rows[BOUNDS.start :, :NV] = data.A[: BOUNDS.start], data.B
        x, _, status, _ = self._daqp.solve(
            data.P, data.q, rows, np.concatenate(upper), np.concatenate(lower), sense
        )
        text = f"daqp exit {status}"
        return _held(data, x, text) if status in _DAQP_SOLVED else Solution(x, False, text)


class QuadprogSolver:
    """quadprog (Goldfarb-Idnani): exact; the reference in the tests."""

    name = "quadprog"

    def __init__(self) -> None:
        try:
            import quadprog
        except ImportError as error:
            raise SolverUnavailableError(
                "solver 'quadprog' is not installed; pip install quadprog, or choose solver osqp"
            ) from error
        self._quadprog = quadprog

    def solve(self, data: QpData) -> Solution:
        """Solve from scratch."""
        bounded_below = data.l > -0.5 * INFINITY
        bounded_above = data.u < 0.5 * INFINITY
        bounded_below[:EQUALITIES] = bounded_above[:EQUALITIES] = False
        C = np.vstack((data.A[:EQUALITIES], data.A[bounded_below], -data.A[bounded_above]))
        b = np.concatenate((data.l[:EQUALITIES], data.l[bounded_below], -data.u[bounded_above]))
        # Each soft row has a variable that makes up for its violation.
        count = len(data.b)
        soft = np.hstack((data.B, np.zeros((count, NUM_VARIABLES - NV)), np.eye(count)))
        C = np.vstack((np.pad(C, ((0, 0), (0, count))), soft))
        P = np.pad(data.P, (0, count))
        P[range(NUM_VARIABLES, len(P)), range(NUM_VARIABLES, len(P))] = SLACK_WEIGHT
        q, b = np.pad(data.q, (0, count)), np.concatenate((b, data.b))
        try:
            x = self._quadprog.solve_qp(P, -q, C.T.copy(), b, EQUALITIES)[0][:NUM_VARIABLES]
        except ValueError as error:
            return Solution(np.zeros(NUM_VARIABLES), False, str(error))
        return _held(data, x, "solved")


_SOLVERS = {"osqp": OsqpSolver, "daqp": DaqpSolver, "quadprog": QuadprogSolver}


def make_solver(name: str) -> Solver:
    """Return the solver of a name.

    Raises:
        SolverUnavailableError: the name is unknown, or its package is not installed.
    """
    if name not in _SOLVERS:
        raise SolverUnavailableError(f"unknown solver {name!r}, expected one of {list(_SOLVERS)}")
    if name == OsqpSolver.name:
        return OsqpSolver(fallback=exact_solver())
    solver: Solver = _SOLVERS[name]()
    return solver


def exact_solver() -> Solver | None:
    """Return the solver for QPs that another does not finish; None if it is not installed."""
    try:
        return DaqpSolver()
    except SolverUnavailableError:
        return None
