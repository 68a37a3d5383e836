"""Solves the controller's QPs by a dual active-set method in compiled code.

It is exact and starts from nothing, so that a solution depends on its QP alone, and takes 10 µs and
1 to 3 µs for each row that binds. Where the kernel is not built, rows are guessed in Python
(active_set.py) and a QP solver has the rest.
"""

from types import ModuleType

import numpy as np

from common.native import kernel
from services.wbc.active_set import TOLERANCE, ActiveSet
from services.wbc.layout import NV
from services.wbc.qp import NUM_VARIABLES, QpData
from services.wbc.solvers import (
    EQUALITIES,
    SLACK_WEIGHT,
    Solution,
    Solver,
    exact_solver,
    make_solver,
)


class DualMethod:
    """Goldfarb and Idnani's method, backed by another solver.

    Args:
        name: what it is called in messages.
        compiled: the kernel.
        inner: solver of the QPs for which it finds no solution; None: they are reported unsolved.

    Attributes:
        asked: number of QPs that were left to the other solver.
    """

    def __init__(self, name: str, compiled: ModuleType, inner: Solver | None) -> None:
        self.name, self.asked = name, 0
        self._solve, self._inner = compiled.solve, inner

    def solve(self, data: QpData) -> Solution:
        """Solve one QP."""
        x = np.zeros(NUM_VARIABLES)
        binding = self._solve(
            data.P, data.q, data.A, data.l, data.u, data.B, data.b, x,
            NV, EQUALITIES, SLACK_WEIGHT, TOLERANCE,
        )  # fmt: skip
        if binding >= 0:
            return Solution(x, True, f"{binding} rows bind")
        self.asked += 1
        if self._inner is None:
            return Solution(x, False, "no solution")
        return self._inner.solve(data)


def controller_solver(name: str) -> Solver:
    """Return what solves a controller's QPs; ``name`` is the solver to ask without the kernel.

    Raises:
        SolverUnavailableError: its package is not installed.
    """
    compiled = kernel("services.wbc._dual_method")
    if compiled is None:
        return ActiveSet(make_solver(name))
    return DualMethod(name, compiled, exact_solver())
