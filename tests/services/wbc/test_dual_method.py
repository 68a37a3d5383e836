"""The compiled dual method against an exact solver: recorded QPs, random ones, and none at all."""

import numpy as np
import pytest

from common.native import kernel
from services.wbc.active_set import ActiveSet
from services.wbc.dual_method import DualMethod, controller_solver
from services.wbc.layout import NV
from services.wbc.qp import BOUNDS, CONES, INFINITY, NORMAL, NUM_VARIABLES, QpData
from services.wbc.solvers import Solution, make_solver

from .bench import Tick
from .support import Array, copy_qp

compiled = kernel("services.wbc._dual_method")
pytestmark = pytest.mark.skipif(
    compiled is None, reason="the kernel is not built; python hatch_build.py builds it"
)


def _solve(data: QpData) -> Solution:
    assert compiled is not None
    return DualMethod("alone", compiled, None).solve(data)


def _exact(data: QpData) -> Array:
    solution = make_solver("quadprog").solve(data)
    assert solution.solved
    return solution.x


def _difference(a: Array, b: Array) -> float:
    return float(np.abs(a - b).max() / np.abs(b).max())


@pytest.fixture(params=["walk", "rated_walk"])
def ticks(request: pytest.FixtureRequest) -> list[Tick]:
    recorded: list[Tick] = request.getfixturevalue(request.param)
    return recorded


def test_each_tick_of_a_walk_is_solved_as_by_an_exact_solver(ticks: list[Tick]) -> None:
    for tick in ticks:
        solution = _solve(tick.data)
        assert solution.solved
        assert _difference(solution.x, _exact(tick.data)) < 1e-9


def test_the_rows_that_bind_are_those_that_guesses_find(ticks: list[Tick]) -> None:
    guessing = ActiveSet(make_solver("daqp"))
    for tick in ticks:
        asked = guessing.asked
        guessed = guessing.solve(tick.data)
        if guessing.asked == asked:
            solution = _solve(tick.data)
            assert solution.status == guessed.status
            assert _difference(solution.x, guessed.x) < 1e-9


def _random(data: QpData, rng: np.random.Generator) -> QpData:
    """Rows of a recorded QP turned and pulled in until many bind, with soft rows besides."""
    qp = copy_qp(data)
    x = _solve(data).x
    qp.q = qp.q + rng.normal(size=NUM_VARIABLES) * np.abs(qp.q).max() * 0.1
    accelerations = rng.normal(size=NV) * 2.0
    qp.l[BOUNDS] = x[6:NV] - np.abs(accelerations[6:])
    qp.u[BOUNDS] = x[6:NV] + np.abs(rng.normal(size=NV - 6))
    qp.B = rng.normal(size=(5, NV))
    # The last of them says the same as the first.
    qp.B[4] = qp.B[0]
    qp.b = qp.B @ x[:NV] + rng.normal(size=5)
    return qp


def test_random_qps_with_many_binding_and_soft_rows(walk: list[Tick]) -> None:
    rng = np.random.default_rng(5)
    binding = []
    for tick in walk[:: len(walk) // 60]:
        data = _random(tick.data, rng)
        solution = _solve(data)
        assert solution.solved
        assert _difference(solution.x, _exact(data)) < 1e-8
        binding.append(int(solution.status.split()[0]))
    assert max(binding) > 12


def test_rows_that_depend_on_each_other(walk: list[Tick]) -> None:
    """Three bounds on the neck, of which two are the same: no matrix of all is regular."""
    data = copy_qp(walk[len(walk) // 2].data)
    free = _solve(data).x
    neck = BOUNDS.stop - 1
    data.A[neck - 1] = 2.0 * data.A[neck]
    data.u[neck], data.u[neck - 1] = free[NV - 1] - 1.0, 2.0 * (free[NV - 1] - 1.0)
    limited = _solve(data)
    assert limited.x[NV - 1] == pytest.approx(free[NV - 1] - 1.0, abs=1e-9)
    assert _difference(limited.x, _exact(data)) < 1e-9


def test_rows_that_nearly_depend_on_each_other(walk: list[Tick]) -> None:
    """One joint's upper bound, and a lower one of a row that differs by 1e-8 of another joint."""
    data = copy_qp(walk[len(walk) // 2].data)
    free = _solve(data).x
    one, other = BOUNDS.stop - 3, BOUNDS.stop - 2
    # So large that 1e-8 of it counts as violated.
    data.A[other] = 1e8 * data.A[one] + data.A[other]
    data.u[one] = data.A[one] @ free - 1.0
    data.l[other], data.u[other] = 1e8 * data.u[one] + free[NV - 2] + 1.0, INFINITY
    solution = _solve(data)
    assert solution.solved
    assert data.A[one] @ solution.x == pytest.approx(data.u[one], abs=1e-9)
    assert solution.x[NV - 2] == pytest.approx(free[NV - 2] + 1.0, abs=1e-5)


def test_rows_that_contradict_each_other_have_no_solution(walk: list[Tick]) -> None:
    data = copy_qp(walk[len(walk) // 2].data)
    neck = BOUNDS.stop - 1
    data.A[neck - 1] = 2.0 * data.A[neck]
    data.u[neck], data.l[neck - 1] = -1.0, -1.0
    assert not _solve(data).solved


def test_rows_without_bounds_never_bind(walk: list[Tick]) -> None:
    data = copy_qp(walk[len(walk) // 2].data)
    free = _solve(data)
    limit = copy_qp(data)
    limit.u[NORMAL] = free.x[[NV + 2, NV + 8]] - 5.0
    assert not np.array_equal(_solve(limit).x, free.x)
    limit.u[NORMAL] = INFINITY
    assert np.abs(_solve(limit).x - free.x).max() < 1e-9 * np.abs(free.x).max()


def _infeasible(data: QpData) -> QpData:
    bad = copy_qp(data)
    bad.u[NORMAL] = -50.0  # feet that must pull
    bad.l[CONES.start] = bad.l[CONES.start + 17] = 0.0
    return bad


def test_a_qp_without_a_solution_is_left_to_the_other_solver(walk: list[Tick]) -> None:
    assert compiled is not None
    bad = _infeasible(walk[len(walk) // 2].data)
    assert not _solve(bad).solved
    solver = DualMethod("both", compiled, make_solver("daqp"))
    result = solver.solve(bad)
    assert (result.solved, solver.asked) == (False, 1)
    assert result.status.startswith("daqp")


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("where", ["q", "P", "A", "l", "u"])
def test_numbers_that_are_none_are_not_called_a_solution(
    where: str, value: float, walk: list[Tick]
) -> None:
    bad = copy_qp(walk[len(walk) // 2].data)
    array = getattr(bad, where)
    # In the last row an infinite upper bound is none, and thus no error.
    array.flat[-1 if where == "u" and np.isnan(value) else 0] = value
    expected = where == "u" and np.isinf(value)
    assert _solve(bad).solved == expected


def test_arrays_that_do_not_fit_are_refused(walk: list[Tick]) -> None:
    good = walk[0].data
    for field, wrong, message in (
        ("q", good.q.astype(np.float32), "q: expected an array of float64"),
        ("A", good.A[:-1], "A: expected 3956 numbers, got 3913"),
        ("P", good.P[:, ::2], "contiguous"),
        ("b", np.zeros(200), "at most 96"),
    ):
        data = copy_qp(good)
        setattr(data, field, wrong)
        with pytest.raises((TypeError, ValueError, BufferError), match=message):
            _solve(data)


def test_the_controller_uses_it_unless_told_not_to(monkeypatch: pytest.MonkeyPatch) -> None:
    assert isinstance(controller_solver("osqp"), DualMethod)
    monkeypatch.setenv("TRILL_NATIVE", "0")
    solver = controller_solver("osqp")
    assert isinstance(solver, ActiveSet)
    assert solver.name == "osqp"
