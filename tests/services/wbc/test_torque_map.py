"""Reduced torques against forward dynamics of the unreduced robot with its knee constraints."""

import numpy as np
import pinocchio as pin

from common.robot import frames, joints
from services.wbc.config import TaskConfig, WbcConfig
from services.wbc.controller import TORQUE_SHARE
from services.wbc.layout import NV, SIDES
from services.wbc.qp import FORCES, QpBuilder
from services.wbc.robot_model import RobotModel, RobotState
from services.wbc.solvers import make_solver
from services.wbc.tasks import TaskStack

from .bench import Tick
from .support import Array, full_velocity, random_states

LOADED = (1000.0, 1000.0)


def _knee_constraints() -> Array:
    """(2, 33) J_i: rows jp - jd."""
    rows = np.zeros((2, 33))
    for row, (jp, jd) in enumerate(joints.KNEE_INDICES):
        rows[row, 6 + jp], rows[row, 6 + jd] = 1.0, -1.0
    return rows


def _forward_dynamics(
    model: RobotModel, state: RobotState, torque: Array, wrenches: tuple[Array, Array]
) -> tuple[Array, Array, Array]:
    """Accelerations (33,) and knee forces (2,) under joint torques and sole wrenches, by KKT.

    Solves M a + h = S' tau + sum J_f' f + J_i' lam with J_i a = 0, J_i being constant. Also
    returns the (33,) force that the motion needs and that torques and wrenches do not supply.
    """
    full, data = model.model, model.model.createData()
    mass = pin.crba(full, data, state.position)
    mass = np.triu(mass) + np.triu(mass, 1).T
    force = -pin.rnea(full, data, state.position, state.velocity, np.zeros(33))
    force[6:] += torque
    for side, wrench in zip(SIDES, wrenches, strict=True):
        index = full.getFrameId(frames.FOOT_FRAMES[side])
        jacobian = pin.computeFrameJacobian(full, data, state.position, index, pin.LOCAL)
        force += jacobian.T @ wrench
    knees = _knee_constraints()
    system = np.block([[mass, -knees.T], [knees, np.zeros((2, 2))]])
    solution = np.linalg.solve(system, np.concatenate((force, np.zeros(2))))
    return solution[:33], solution[33:], mass @ solution[:33] - force


def _with_equal_halves(state: RobotState) -> RobotState:
    """The state as the model takes it: the halves of a simulated knee differ by up to 3e-5 rad."""
    share = (joints.MOTOR_TO_JOINT / joints.MOTOR_TO_JOINT.sum(axis=0)).T
    halves = [
        np.concatenate((values[:base], joints.MOTOR_TO_JOINT @ share @ values[base:]))
        for values, base in ((state.position, 7), (state.velocity, 6))
    ]
    return RobotState(*halves)


def _assert_closed(
    model: RobotModel, state: RobotState, motors: Array, x: Array, tolerance: float
) -> None:
    wanted = full_velocity(x[:NV])
    wrenches = x[FORCES[0]], x[FORCES[1]]
    got, _, rest = _forward_dynamics(model, state, TORQUE_SHARE @ motors, wrenches)
    assert np.abs(got - wanted).max() < tolerance * np.abs(wanted).max()
    # The floating base has no motor: wrenches alone must carry what it does.
    weight = model.mass * 9.81
    assert np.abs(rest[:6]).max() < tolerance * weight


def test_torques_close_the_constrained_dynamics(model: RobotModel) -> None:
    rng = np.random.default_rng(12)
    builder, stack = QpBuilder(WbcConfig()), TaskStack(TaskConfig())
    for plant_state in random_states(20, seed=77):
        state = RobotState.from_plant(plant_state)
        dynamics = model.update(state)
        data = builder.build(dynamics, stack, LOADED, (0.0, 0.0))
        x = np.concatenate((10.0 * rng.normal(size=NV), 100.0 * rng.normal(size=12)))
        # Any joint accelerations and wrenches are consistent with just one base acceleration.
        rest = data.l[:6] - data.A[:6, 6:] @ x[6:]
        x[:6] = np.linalg.solve(data.A[:6, :6], rest)
        _assert_closed(model, state, builder.torques(dynamics, x), x, 1e-9)


def test_solutions_of_a_walk_close_the_constrained_dynamics(
    model: RobotModel, walk: list[Tick]
) -> None:
    builder, solver = QpBuilder(WbcConfig()), make_solver("daqp")
    for tick in walk[::10]:
        solution = solver.solve(tick.data)
        assert solution.solved
        state = _with_equal_halves(RobotState.from_plant(tick.state))
        builder.data = tick.data
        motors = builder.torques(model.update(state), solution.x)
        _assert_closed(model, state, motors, solution.x, 1e-9)


def test_knee_halves_share_their_torque(model: RobotModel) -> None:
    """The two hinges of a knee get equal torques, which work like one on the coordinate."""
    motors = np.arange(1.0, 26.0)
    shared = TORQUE_SHARE @ motors
    for motor, (jp, jd) in zip(("l_knee", "r_knee"), joints.KNEE_INDICES, strict=True):
        assert shared[jp] == shared[jd] == 0.5 * motors[joints.MOTOR_NAMES.index(motor)]
    assert np.array_equal(joints.MOTOR_TO_JOINT.T @ shared, motors)
