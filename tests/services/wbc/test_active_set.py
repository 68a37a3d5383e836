"""Solutions from guessed rows against an exact solver, and when another solver is asked."""

import numpy as np
import pytest
from numpy.typing import NDArray

from services.wbc.active_set import ActiveSet
from services.wbc.layout import NV
from services.wbc.qp import CONES, FORCES, NORMAL, TORQUE, QpData
from services.wbc.solvers import Solution, make_solver

from .bench import Tick
from .support import Array, copy_qp


class Unwanted:
    """A solver that must not be asked."""

    name = "unwanted"

    def solve(self, data: QpData) -> Solution:
        raise AssertionError("asked")


@pytest.fixture(params=["walk", "rated_walk"])
def ticks(request: pytest.FixtureRequest) -> list[Tick]:
    recorded: list[Tick] = request.getfixturevalue(request.param)
    return recorded


def _exact(data: QpData) -> Array:
    solution = make_solver("quadprog").solve(data)
    assert solution.solved
    return solution.x


def test_solutions_are_those_of_an_exact_solver(ticks: list[Tick]) -> None:
    solver = ActiveSet(make_solver("daqp"))
    for tick in ticks:
        solution, exact = solver.solve(tick.data), _exact(tick.data)
        assert solution.solved
        difference = tick.data.A[TORQUE] @ (solution.x - exact)
        assert np.abs(difference).max() < 1e-4  # N·m, of up to 100
    # Recorded every few ticks, so that rows change more often than in the loop.
    assert solver.asked < 0.15 * len(ticks)


def test_without_inequalities_that_bind_no_solver_is_asked(walk: list[Tick]) -> None:
    free = [t.data for t in walk if not _bound(t.data, _exact(t.data)).any()]
    assert len(free) > 0.6 * len(walk)
    for data in free:
        assert ActiveSet(Unwanted()).solve(data).solved


def _bound(data: QpData, x: Array) -> NDArray[np.bool_]:
    rows = data.A @ x
    met: NDArray[np.bool_] = np.minimum(np.abs(rows - data.l), np.abs(rows - data.u)) < 1e-6
    return met[6:]


def test_a_row_that_binds_is_found_and_remembered(walk: list[Tick]) -> None:
    data = copy_qp(next(t.data for t in walk if not _bound(t.data, _exact(t.data)).any()))
    solver = ActiveSet(Unwanted())
    free = solver.solve(data).x
    acceleration = data.A[-1] @ free  # of the neck
    data.u[-1] = acceleration - 1.0
    for status in ("1 rows bind", "1 rows bind"):
        limited = solver.solve(data)
        assert limited.status == status
        assert data.A[-1] @ limited.x == pytest.approx(data.u[-1], abs=1e-9)
        assert np.abs(limited.x - _exact(data)).max() < 1e-5 * np.abs(limited.x).max()
    # And dropped where it only holds back.
    data.u[-1] = acceleration + 1.0
    again = solver.solve(data)
    assert again.status == "0 rows bind"
    assert np.abs(again.x - free).max() < 1e-9 * np.abs(free).max()


def test_rows_that_are_no_longer_bounded_are_forgotten(walk: list[Tick]) -> None:
    """As the cone of a foot that leaves the ground."""
    data = copy_qp(next(t.data for t in walk if not _bound(t.data, _exact(t.data)).any()))
    solver = ActiveSet(Unwanted())
    free = solver.solve(data).x
    data.u[NORMAL.start] = free[FORCES[0]][2] - 5.0
    assert solver.solve(data).status == "1 rows bind"
    data.u[NORMAL.start] = 1e20
    assert np.abs(solver.solve(data).x - free).max() < 1e-6 * np.abs(free).max()


def test_soft_rows_are_met_as_far_as_their_weight_says(walk: list[Tick]) -> None:
    data = copy_qp(next(t.data for t in walk if not _bound(t.data, _exact(t.data)).any()))
    free = ActiveSet(Unwanted()).solve(data).x
    row = np.zeros(NV)
    row[20] = 1.0
    data.B, data.b = row[None, :], np.array([free[20] + 2.0])
    solution = ActiveSet(Unwanted()).solve(data)
    assert solution.status == "1 rows bind"
    assert 0.0 < data.shortfall(solution.x) < 1e-3
    assert np.abs(solution.x - _exact(data)).max() < 1e-4 * np.abs(solution.x).max()


def test_a_qp_without_a_solution_is_left_to_the_solver(walk: list[Tick]) -> None:
    good = walk[len(walk) // 2].data
    bad = copy_qp(good)
    bad.u[NORMAL] = -50.0  # feet that must pull
    bad.l[CONES.start] = bad.l[CONES.start + 17] = 0.0
    solver = ActiveSet(make_solver("daqp"))
    before = solver.solve(good).x
    asked = solver.asked
    assert not solver.solve(bad).solved
    assert solver.asked == asked + 1
    assert np.abs(solver.solve(good).x - before).max() < 1e-6 * np.abs(before).max()


@pytest.mark.parametrize("where", ["q", "P", "A", "l"])
def test_numbers_that_are_none_are_not_called_a_solution(where: str, walk: list[Tick]) -> None:
    bad = copy_qp(walk[len(walk) // 2].data)
    getattr(bad, where).flat[0] = np.nan
    solver = ActiveSet(make_solver("daqp"))
    assert not solver.solve(bad).solved
    assert solver.asked == 1
    assert solver.solve(walk[0].data).solved
