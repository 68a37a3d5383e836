"""Distances of arms and body against MuJoCo's, against differences, and in the QP."""

from itertools import product

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from common.robot import joints
from common.robot.frames import COLLISION_SUFFIX
from services.wbc.clearance import HULLS, PAIRS, REACH, UPPER_ARM_REACH
from services.wbc.config import LimitConfig, TaskConfig, WbcConfig
from services.wbc.errors import ModelError
from services.wbc.layout import ARM_COLUMNS, NV
from services.wbc.qp import QpBuilder, QpData
from services.wbc.robot_model import Dynamics, RobotModel, RobotState
from services.wbc.solvers import SHORTFALL, make_solver
from services.wbc.tasks import TaskStack

from .bench import Tick
from .support import Array, copy_qp, make_state, nominal_state, random_states

STATES = 60
STEP = 1e-6
SOLVERS = ("osqp", "daqp", "quadprog")


def _states(count: int, seed: int) -> list[RobotState]:
    return [RobotState.from_plant(state) for state in random_states(count, seed)]


@pytest.fixture(scope="module")
def plant() -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_path(str(joints.MJCF_PATH))
    return model, mujoco.MjData(model)


def _pose(data: mujoco.MjData, state: RobotState) -> None:
    data.qpos[:3] = state.position[:3]
    data.qpos[3:7] = np.roll(state.position[3:7], 1)
    for name, angle in zip(joints.JOINT_NAMES, state.position[7:], strict=True):
        data.joint(name).qpos[0] = angle
    for pair in joints.FINGER_JOINTS.values():
        for name in pair:
            data.joint(name).qpos[0] = 0.5 * joints.GRIPPER_STROKE


def _geoms(part: str) -> list[str]:
    return [name + COLLISION_SUFFIX for name in HULLS.get(part, (part,))]


def test_distances_are_those_of_the_plants_own_geoms(
    plant: tuple[mujoco.MjModel, mujoco.MjData],
) -> None:
    """A hull is never farther off than its geoms, and as far where they are its nearest part."""
    (mj_model, mj_data), model, seen, same = plant, RobotModel(), 0, 0
    for state in _states(STATES, seed=31):
        clearance = model.update(state).clearance
        reported = dict(zip(clearance.pairs, clearance.distance, strict=True))
        _pose(mj_data, state)
        mujoco.mj_forward(mj_model, mj_data)
        for pair in PAIRS:
            distance = min(
                mujoco.mj_geomDistance(
                    mj_model, mj_data, mj_model.geom(one).id, mj_model.geom(other).id, 1.0, None
                )
                for one, other in product(*map(_geoms, pair))
            )
            if pair not in reported:
                assert distance > (UPPER_ARM_REACH if "upper" in pair[0] else REACH) - 1e-4
            elif distance > 0.0:
                seen += 1
                same += abs(reported[pair] - distance) < 1e-4
                assert -0.05 < reported[pair] - distance < 1e-4, pair
    assert seen > 60
    assert same > 0.6 * seen


def _moved(model: RobotModel, state: RobotState, time: float) -> dict[tuple[str, str], float]:
    """Distances after some time at the state's velocity."""
    position = pin.integrate(model.model, state.position, time * state.velocity)
    near = model.update(RobotState(position, state.velocity)).clearance
    return dict(zip(near.pairs, near.distance, strict=True))


def test_rate_and_jacobian_against_differences() -> None:
    """Away from overlap and from edges, where the nearest points jump."""
    model, seen = RobotModel(), 0
    for state in _states(STATES, seed=32):
        clearance = model.update(state).clearance

        ahead, behind = (_moved(model, state, length) for length in (STEP, -STEP))
        for k, pair in enumerate(clearance.pairs):
            if not (0.002 < clearance.distance[k] < REACH - 0.01):
                continue
            here = clearance.distance[k]
            one, other = (ahead[pair] - here) / STEP, (here - behind[pair]) / STEP
            if abs(one - other) < 1e-2:
                seen += 1
                assert clearance.rate[k] == pytest.approx(0.5 * (one + other), abs=5e-3), pair
    assert seen > 15


def test_only_the_arms_move_out_of_the_way() -> None:
    """Neither the base nor the legs shall be moved to make room for an arm."""
    model, seen = RobotModel(), 0
    for state in _states(STATES, seed=33):
        for pair, row in zip(*_rows(model.update(state)), strict=True):
            arms = {0 if part.startswith("l_") else 1 for part in pair if _in_arm(part)}
            for arm, columns in enumerate((slice(18, 24), slice(24, 30))):
                assert row[columns].any() == (arm in arms), pair
            assert not row[:18].any()
            seen += "hip" in pair[1]
    assert seen > 5


def _rows(dynamics: Dynamics) -> tuple[list[tuple[str, str]], Array]:
    return dynamics.clearance.pairs, dynamics.clearance.jacobian


def _in_arm(part: str) -> bool:
    return part != "trunk" and "hip" not in part


def test_skipping_far_pairs_changes_nothing() -> None:
    """Along a motion a model that remembers reports what a new one does."""
    rng = np.random.default_rng(5)
    kept, seen = RobotModel(), 0
    start, end = _states(2, seed=34)
    for tick, share in enumerate(np.cumsum(rng.uniform(0.0, 0.04, 60)) % 1.0):
        position = pin.interpolate(kept.model, start.position, end.position, float(share))
        state = RobotState(position, start.velocity)
        one = kept.update(state).clearance
        if tick % 10:
            continue
        other = RobotModel().update(state).clearance
        assert one.pairs == other.pairs
        # The solver of distances starts from its last nearest points, to half a micrometre.
        assert np.abs(one.distance - other.distance).max(initial=0.0) < 2e-6
        assert np.abs(one.jacobian - other.jacobian).max(initial=0.0) < 2e-3
        seen += len(one.pairs)
    assert seen > 10


def test_no_joint_moves_a_part_faster_than_its_lever() -> None:
    model, levers, closest = RobotModel(), {}, 1.0
    for pair, row in zip(PAIRS, model.clearance_model.levers, strict=True):
        levers[pair] = row[joints.LEFT_ARM.start : joints.RIGHT_ARM.stop]
    for state in _states(STATES, seed=35):
        for pair, row in zip(*_rows(model.update(state)), strict=True):
            left = levers[pair] - np.abs(row[ARM_COLUMNS])
            assert left.min() > -1e-9, pair
            closest = min(closest, (left[levers[pair] > 0.0] / levers[pair].max()).min())
    # The bound is not idle: some joint comes near it.
    assert closest < 0.3


def test_missing_geom_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(HULLS, "trunk", ("chest", "belly"))
    with pytest.raises(ModelError, match="belly_col"):
        RobotModel()


def _with_rows(tick: Tick) -> QpData:
    """A tick's QP with a row for each shoulder, far from binding."""
    data = copy_qp(tick.data)
    assert data.B.shape == (0, NV)
    data.B = np.zeros((2, NV))
    for row, shoulder in enumerate((18, 24)):
        data.B[row, shoulder : shoulder + 3] = 0.05, 0.2, -0.1
    data.b = data.B @ tick.solution.x[:NV] - 2.0
    return data


@pytest.fixture
def good(walk: list[Tick]) -> QpData:
    return _with_rows(walk[len(walk) // 2])


@pytest.mark.parametrize("name", SOLVERS)
def test_soft_rows_are_kept_where_they_bind_and_change_nothing_elsewhere(
    name: str, good: QpData
) -> None:
    bare = copy_qp(good)
    bare.B, bare.b = good.B[:0], good.b[:0]
    free = make_solver(name).solve(bare)
    assert np.array_equal(make_solver(name).solve(good).x, free.x)
    good.b[:] = good.B @ free.x[:NV] + 5.0
    result = make_solver(name).solve(good)
    assert result.solved
    assert 0.0 < good.shortfall(result.x) + SHORTFALL < 2.0 * SHORTFALL


@pytest.mark.parametrize("name", SOLVERS)
def test_rows_that_cannot_be_kept_leave_a_solution(name: str, good: QpData) -> None:
    good.B, good.b = np.vstack((good.B, -good.B)), np.full(4, 20.0)
    result = make_solver(name).solve(good)
    assert result.solved
    assert good.shortfall(result.x) == pytest.approx(20.0, abs=0.1)
    rows = good.A @ result.x
    assert np.maximum(good.l - rows, rows - good.u).max() < 0.02


def test_osqp_returns_to_its_own_solutions(walk: list[Tick]) -> None:
    """After ticks with binding rows the default solver goes on as if there had been none."""
    solver = make_solver("osqp")
    middle = len(walk) // 2
    for k, tick in enumerate(walk[middle : middle + 12]):
        data = _with_rows(tick)
        if 2 <= k < 6:
            data.b[:] = 5.0
        result = solver.solve(data)
        assert result.solved
        if k != 6:  # in which the rows are found not to bind any more
            assert ("daqp" in result.status) == (2 <= k < 6), k
        if k > 6:
            assert np.abs(result.x - tick.solution.x)[:NV].max() < 20.0


def test_barrier_brakes_an_approach_and_pushes_out_of_the_margin() -> None:
    limits = LimitConfig(clearance_margin=0.02, clearance_stiffness=100.0, clearance_damping=20.0)
    builder = QpBuilder(WbcConfig(limits=limits))
    model = RobotModel()
    state = nominal_state()
    shoulder = joints.JOINT_NAMES.index("l_shoulder_aa")
    position, velocity = state.joint_position.copy(), state.joint_velocity.copy()
    position[shoulder] -= 0.3
    velocity[shoulder] = -1.0  # inwards
    moving = make_state(state.base_position, state.base_quaternion, position, None, velocity)
    dynamics = model.update(RobotState.from_plant(moving))
    data = builder.build(dynamics, TaskStack(TaskConfig()), (800.0, 800.0), (180.0, 180.0))
    index = dynamics.clearance.pairs.index(("l_upper_arm", "trunk"))
    distance, rate = dynamics.clearance.distance[index], dynamics.clearance.rate[index]
    assert rate < -0.05
    assert data.b[index] == pytest.approx(-100.0 * (distance - 0.02) - 20.0 * rate)
