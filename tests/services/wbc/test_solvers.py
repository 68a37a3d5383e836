"""OSQP against two exact solvers on a recorded walk, and QPs without a solution."""

from typing import NamedTuple

import numpy as np
import pytest

from common.schemas import ControlState
from services.wbc.config import WbcConfig
from services.wbc.qp import CONES, FORCES, NORMAL, QpBuilder, QpData
from services.wbc.robot_model import RobotModel, RobotState
from services.wbc.solvers import FEASIBLE, OsqpSolver, Solution, make_solver

from .bench import Tick
from .support import Array, copy_qp

SOLVERS = ["osqp", "daqp", "quadprog"]
EXACT = ["daqp", "quadprog"]


class Comparison(NamedTuple):
    """Largest disagreement of OSQP per tick: torque [N·m], acceleration [rad/s²]."""

    torque: Array
    acceleration: Array


def _torques(model: RobotModel, tick: Tick, x: Array) -> Array:
    builder = QpBuilder(WbcConfig())
    builder.data = tick.data
    return builder.torques(model.update(RobotState.from_plant(tick.state)), x)


def _exact(tick: Tick, name: str) -> Array:
    solution = make_solver(name).solve(tick.data)
    assert solution.solved, solution.status
    return solution.x


def _violation(data: QpData, x: Array) -> float:
    rows = data.A @ x
    return float(np.maximum(data.l - rows, rows - data.u).max())


def _compare(model: RobotModel, ticks: list[Tick]) -> Comparison:
    torque, acceleration = [], []
    for tick in ticks:
        x, exact = tick.solution.x, _exact(tick, "quadprog")
        difference = _torques(model, tick, x) - _torques(model, tick, exact)
        torque.append(np.abs(difference).max())
        acceleration.append(np.abs(x - exact)[:31].max())
    return Comparison(np.array(torque), np.array(acceleration))


@pytest.fixture(params=["walk", "rated_walk"])
def ticks(request: pytest.FixtureRequest) -> list[Tick]:
    recorded: list[Tick] = request.getfixturevalue(request.param)
    return recorded


def test_exact_solvers_agree(ticks: list[Tick]) -> None:
    for tick in ticks:
        one, other = _exact(tick, "daqp"), _exact(tick, "quadprog")
        assert np.abs(one - other).max() < 1e-6 * np.abs(other).max()


def test_osqp_agrees_with_an_exact_solver(model: RobotModel, ticks: list[Tick]) -> None:
    """Legs carry up to 100 N·m; the controller's loop gain forgives the rare newton metre."""
    assert all(tick.solution.solved for tick in ticks)
    comparison = _compare(model, ticks)
    assert np.median(comparison.torque) < 0.1
    assert np.quantile(comparison.torque, 0.99) < 1.5
    assert comparison.torque.max() < 5.0
    assert np.median(comparison.acceleration) < 0.1


def test_solutions_satisfy_their_constraints(model: RobotModel, ticks: list[Tick]) -> None:
    builder = QpBuilder(WbcConfig())
    for tick in ticks:
        data, x = tick.data, tick.solution.x
        assert _violation(data, x) <= FEASIBLE  # 5 mN, mN·m on a robot of 358 N
        builder.data = data
        motors = builder.torques(model.update(RobotState.from_plant(tick.state)), x)
        sent = tick.command.torque
        assert np.abs(sent.sum() - motors.sum()) < 1e-9


def test_osqp_alone_returns_nothing_that_breaks_a_constraint(walk: list[Tick]) -> None:
    """It calls some of these solutions "solved inaccurate"; they are refused, not used."""
    solver = OsqpSolver(fallback=None)
    results = [(tick.data, solver.solve(tick.data)) for tick in walk]
    refused = [_violation(data, r.x) for data, r in results if "inacc" in r.status and not r.solved]
    assert max(_violation(data, r.x) for data, r in results if r.solved) <= FEASIBLE
    assert refused
    assert min(refused) > FEASIBLE


def test_swinging_feet_carry_nothing(ticks: list[Tick]) -> None:
    seen = [0, 0]
    for tick in ticks:
        for side, swing in enumerate((ControlState.LF_SWING, ControlState.RF_SWING)):
            if tick.control is not swing:
                continue
            seen[side] += 1
            # The wrench enters no equation and costs a little: zero, for OSQP nearly so.
            assert not tick.data.A[:31, FORCES[side]].any()
            assert np.abs(_exact(tick, "daqp")[FORCES[side]]).max() < 1e-6
            assert np.abs(tick.solution.x[FORCES[side]]).max() < 10.0
            standing = tick.solution.x[FORCES[1 - side]]
            assert 250.0 < standing[2] < 550.0
    assert min(seen) > 20


def test_both_feet_share_the_weight_while_balancing(ticks: list[Tick]) -> None:
    forces = np.array(
        [
            [tick.solution.x[columns][2] for columns in FORCES]
            for tick in ticks
            if tick.control is ControlState.BALANCE
        ]
    )
    assert len(forces) > 10
    assert np.abs(forces.sum(axis=1) - 358.3).mean() < 40.0
    assert forces.min() > 50.0


def test_rated_torques_keep_their_limits(model: RobotModel, rated_walk: list[Tick]) -> None:
    builder = QpBuilder(WbcConfig.model_validate({"limits": {"torque_mode": "rated"}}))
    shares = []
    for tick in rated_walk:
        torque = _torques(model, tick, tick.solution.x)
        shares.append((np.abs(torque) / builder.torque_limit).max())
        # Either half of a knee is sent at most its rated 40.85 N·m.
        assert np.abs(tick.command.torque).max() < 59.6 + 0.01
        assert np.abs(tick.command.torque[[3, 4, 10, 11]]).max() < 40.85 + 0.01
    assert max(shares) < 1.0 + 1e-3
    # The limits were met, so it was they that held.
    assert max(shares) > 0.999


def test_relaxed_torques_exceed_the_rated_limits(model: RobotModel, walk: list[Tick]) -> None:
    """Single support with the CoM at 0.70 m asks more of a knee than its rated 81.7 N·m."""
    torques = np.array([_torques(model, tick, tick.solution.x) for tick in walk])
    assert np.abs(torques).max() > 90.0


@pytest.fixture
def good(walk: list[Tick]) -> QpData:
    return copy_qp(walk[len(walk) // 2].data)


@pytest.mark.parametrize("name", SOLVERS)
def test_a_qp_without_a_solution_is_reported(name: str, good: QpData) -> None:
    solver = make_solver(name)
    assert solver.name == name
    before = solver.solve(good)
    assert before.solved
    bad = copy_qp(good)
    bad.u[NORMAL] = -50.0  # feet that must pull
    bad.l[CONES.start] = bad.l[CONES.start + 17] = 0.0
    result = solver.solve(bad)
    assert not result.solved
    assert result.status
    # And the next good one is solved as if nothing had been.
    after = solver.solve(good)
    assert after.solved
    assert np.abs(after.x - before.x).max() < 0.05


@pytest.mark.parametrize("name", ["osqp", *EXACT])
@pytest.mark.parametrize("where", ["q", "P"])
def test_numbers_that_are_none_are_not_called_a_solution(
    name: str, where: str, good: QpData
) -> None:
    solver = make_solver(name)
    bad = copy_qp(good)
    getattr(bad, where).flat[0] = np.nan
    assert solver.solve(good).solved
    result = solver.solve(bad)
    assert not result.solved
    assert solver.solve(good).solved


@pytest.mark.parametrize("name", SOLVERS)
def test_solving_leaves_the_qp_alone(name: str, good: QpData) -> None:
    before = copy_qp(good)
    make_solver(name).solve(good)
    for field in ("P", "q", "A", "l", "u"):
        assert np.array_equal(getattr(good, field), getattr(before, field))


def test_osqp_starts_from_the_last_solution(walk: list[Tick]) -> None:
    """Along the walk a kept workspace is as good as a new one, whatever it was updated from."""
    kept = make_solver("osqp")
    for tick in walk[::7]:
        result: Solution = kept.solve(tick.data)
        assert result.solved
        fresh = make_solver("osqp").solve(tick.data)
        assert np.abs(result.x - fresh.x)[:31].max() < 20.0
