"""What each block of the QP means, term by term against its definition."""

import numpy as np
import pytest

from common.robot import joints
from services.wbc.config import ContactConfig, LimitConfig, TaskConfig, WbcConfig
from services.wbc.layout import NV
from services.wbc.qp import (
    AIRBORNE,
    ARM_BOUNDS,
    BOUNDS,
    CONES,
    DYNAMICS,
    FORCES,
    NORMAL,
    NUM_CONSTRAINTS,
    NUM_VARIABLES,
    TORQUE,
    QpBuilder,
    QpData,
    wrench_cone,
)
from services.wbc.robot_model import Dynamics, RobotModel, RobotState
from services.wbc.tasks import NUM_ROWS, TaskStack

from .bench import Bench
from .support import Array, nominal_state, random_states, setpoint

FZ_MAX = (800.0, 300.0)
FZ_WISH = (250.0, 110.0)
CONFIG = WbcConfig(
    tasks=TaskConfig(
        acceleration_regulariser=3e-4, force_regulariser=2e-6, force_reference_weight=5e-6
    ),
    contact=ContactConfig(friction=0.4),
)
Case = tuple[QpBuilder, QpData, Dynamics, TaskStack]


@pytest.fixture(params=range(3))
def case(request: pytest.FixtureRequest, model: RobotModel) -> Case:
    """A QP at a random state with random tasks."""
    rng = np.random.default_rng(request.param)
    dynamics = model.update(RobotState.from_plant(random_states(3, seed=10)[request.param]))
    stack = TaskStack(TaskConfig())
    stack.jacobian[:], stack.target[:] = rng.normal(size=(NUM_ROWS, NV)), rng.normal(size=NUM_ROWS)
    stack.weight[:] = rng.uniform(0.1, 60.0, NUM_ROWS)
    builder = QpBuilder(CONFIG)
    return builder, builder.build(dynamics, stack, FZ_MAX, FZ_WISH), dynamics, stack


def _point(seed: int) -> tuple[Array, Array, tuple[Array, Array]]:
    rng = np.random.default_rng(seed)
    x = np.concatenate((rng.normal(size=NV), 50.0 * rng.normal(size=12)))
    return x, x[:NV], (x[31:37], x[37:43])


def test_layout() -> None:
    assert (NUM_VARIABLES, NUM_CONSTRAINTS) == (43, 92)
    assert (
        slice(6, 31), slice(31, 65), slice(65, 67), slice(67, 92),
    ) == (TORQUE, CONES, NORMAL, BOUNDS)  # fmt: skip
    assert (slice(31, 37), slice(37, 43)) == FORCES


def test_cost_is_the_weighted_sum_of_squares(case: Case) -> None:
    _, data, _, stack = case

    def cost(x: Array) -> float:
        residual = stack.jacobian @ x[:NV] - stack.target
        value = 0.5 * stack.weight @ residual**2 + 0.5 * 3e-4 * x[:NV] @ x[:NV]
        for columns, wish in zip(FORCES, FZ_WISH, strict=True):
            f = x[columns]
            wanted = np.array([0.0, 0.0, wish, 0.0, 0.0, 0.0])
            value += 0.5 * 2e-6 * f @ f + 0.5 * 5e-6 * (f - wanted) @ (f - wanted)
        return float(value)

    zero = np.zeros(NUM_VARIABLES)
    for seed in range(10):
        x, _, _ = _point(seed)
        form = 0.5 * x @ data.P @ x + data.q @ x
        assert form == pytest.approx(cost(x) - cost(zero), rel=1e-9)
    assert np.abs(data.P - data.P.T).max() < 1e-12 * np.abs(data.P).max()
    assert np.linalg.eigvalsh(data.P).min() > 0.0


def test_dynamics_rows(case: Case) -> None:
    """Rows 0 to 5 are the floating base's equation, 6 to 30 the torques of the motors."""
    builder, data, dynamics, _ = case
    x, qdd, wrenches = _point(3)
    force = dynamics.mass_matrix @ qdd + dynamics.bias_force
    for side, wrench in enumerate(wrenches):
        force = force - dynamics.sole_jacobians[side].T @ wrench
    rows = data.A @ x
    assert np.abs(rows[:6] - data.l[:6] - force[:6]).max() < 1e-9
    assert np.array_equal(data.l[:6], data.u[:6])
    assert np.abs(builder.torques(dynamics, x) - force[6:]).max() < 1e-9
    # l <= A x is tau >= -limit, A x <= u is tau <= limit.
    assert np.abs(rows[TORQUE] - data.l[TORQUE] - force[6:] - builder.torque_limit).max() < 1e-9
    assert np.abs(data.u[TORQUE] - rows[TORQUE] + force[6:] - builder.torque_limit).max() < 1e-9


@pytest.mark.parametrize(
    ("mode", "knee", "ankle", "elbow"),
    [("relaxed", 2 * 240.85, 244.0, 10.0), ("rated", 2 * 40.85, 44.0, 10.0)],
)
def test_torque_limits(mode: str, knee: float, ankle: float, elbow: float) -> None:
    limits = LimitConfig.model_validate({"torque_mode": mode})
    table = QpBuilder(WbcConfig(limits=limits)).torque_limit
    by_name = dict(zip(joints.MOTOR_NAMES, table, strict=True))
    for side in ("l", "r"):
        assert by_name[f"{side}_knee"] == pytest.approx(knee)
        assert by_name[f"{side}_ankle_fe"] == pytest.approx(ankle)
        assert by_name[f"{side}_elbow_fe"] == pytest.approx(elbow)


def test_contact_rows(case: Case) -> None:
    _, data, _, _ = case
    x, _, wrenches = _point(5)
    rows = data.A @ x
    cone = wrench_cone(CONFIG.contact)
    assert np.abs(rows[31:48] - cone @ wrenches[0]).max() < 1e-9
    assert np.abs(rows[48:65] - cone @ wrenches[1]).max() < 1e-9
    assert not data.l[CONES].any()
    assert (data.u[CONES] > 1e19).all()
    assert rows[NORMAL] == pytest.approx([wrenches[0][2], wrenches[1][2]])
    assert data.u[NORMAL].tolist() == list(FZ_MAX)
    assert (data.l[NORMAL] < -1e19).all()


def test_acceleration_rows(case: Case) -> None:
    _, data, dynamics, _ = case
    x, qdd, _ = _point(6)
    assert np.array_equal((data.A @ x)[BOUNDS], qdd[6:])
    others = [*range(BOUNDS.start, ARM_BOUNDS.start), BOUNDS.stop - 1]
    assert (data.l[others] == -600.0).all()
    assert (data.u[others] == 600.0).all()
    for row, name in enumerate(joints.MOTOR_NAMES[12:24], start=ARM_BOUNDS.start):
        spec = joints.JOINTS[joints.JOINT_INDEX[name]]
        motor = joints.MOTOR_NAMES.index(name)
        q, v = dynamics.motor_position[motor], dynamics.motor_velocity[motor]
        low = 400.0 * (spec.lower + 0.03 - q) - 40.0 * v
        high = 400.0 * (spec.upper - 0.03 - q) - 40.0 * v
        assert data.l[row] == pytest.approx(np.clip(low, -600.0, 600.0))
        assert data.u[row] == pytest.approx(np.clip(high, -600.0, 600.0))
        assert data.l[row] <= data.u[row]


@pytest.mark.parametrize("side", [0, 1])
def test_an_airborne_foot_has_no_wrench(model: RobotModel, side: int) -> None:
    builder = QpBuilder(CONFIG)
    stack = TaskStack(TaskConfig())
    dynamics = model.update(RobotState.from_plant(nominal_state()))
    standing = builder.build(dynamics, stack, FZ_MAX, FZ_WISH)
    A, l, u = standing.A.copy(), standing.l.copy(), standing.u.copy()  # noqa: E741
    lifted = (AIRBORNE, 500.0) if side == 0 else (500.0, AIRBORNE)
    data = builder.build(dynamics, stack, lifted, (0.0, 0.0))
    other = 1 - side
    assert not data.A[DYNAMICS, FORCES[side]].any()
    assert np.array_equal(data.A[DYNAMICS, FORCES[other]], A[DYNAMICS, FORCES[other]])
    cone = slice(31 + 17 * side, 48 + 17 * side)
    # Nothing bounds what acts on nothing; the regulariser alone keeps it at zero.
    assert (data.l[cone] < -1e19).all()
    assert data.u[NORMAL.start + side] > 1e19
    assert not data.q[FORCES[side]].any()
    assert data.u[NORMAL.start + other] == 500.0
    # Standing again, everything is as before.
    builder.build(dynamics, stack, FZ_MAX, FZ_WISH)
    assert np.array_equal(data.A, A)
    assert np.array_equal(data.l, l)
    assert np.array_equal(data.u, u)


@pytest.mark.parametrize("target", [(0.56, 0.45, -0.15), (0.15, 0.45, -0.15)])
def test_arm_joints_stay_inside_their_limits(target: tuple[float, float, float]) -> None:
    """Hands asked for what the arms cannot reach; without the barrier wrists go 0.2 rad beyond."""
    bench = Bench(WbcConfig(solver="daqp", stand_time=0.3))
    bench.run(0.4)
    left = np.array(target)
    arms = np.arange(joints.LEFT_ARM.start, joints.RIGHT_ARM.stop)
    margin = np.full(len(arms), np.inf)
    for k in range(120):
        if k % 5 == 0:
            bench.send(setpoint(left, left * np.array([1.0, -1.0, 1.0])))
        bench.tick()
        q = bench.plant.truth().joint_position[arms]
        low, high = q - joints.POSITION_LOWER[arms], joints.POSITION_UPPER[arms] - q
        margin = np.minimum(margin, np.minimum(low, high))
    assert 0.02 < margin.min() < 0.1
    assert (bench.states[-1].hand_position_error > 0.1).all()
    assert not bench.plant.fallen
    assert bench.states[-1].unsolved == 0
