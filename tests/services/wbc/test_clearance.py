"""Distances of arms and body against MuJoCo's, against differences, and in the QP."""

from itertools import product

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from common.robot import joints
from common.robot.frames import COLLISION_SUFFIX
from services.wbc.clearance import HULLS, LEVER, PAIRS, REACH
from services.wbc.config import LimitConfig, WbcConfig
from services.wbc.errors import ModelError
from services.wbc.qp import INFINITY, QpBuilder, QpData
from services.wbc.robot_model import NV, Dynamics, RobotModel, RobotState
from services.wbc.solvers import SHORTFALL, make_solver
from services.wbc.tasks import HANDS, TaskStack

from .bench import Tick
from .support import Array, copy_qp, make_state, nominal_state, random_states

STATES = 60
STEP = 1e-6
SOLVERS = ("osqp", "daqp", "quadprog")


def _states(count: int, seed: int) -> list[RobotState]:
    return [RobotState.from_plant(state) for state in random_states(count, seed)]


def _mujoco(state: RobotState) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_path(str(joints.MJCF_PATH))
    data = mujoco.MjData(model)
    data.qpos[:3] = state.position[:3]
    data.qpos[3:7] = np.roll(state.position[3:7], 1)
    for name, angle in zip(joints.JOINT_NAMES, state.position[7:], strict=True):
        data.joint(name).qpos[0] = angle
    for pair in joints.FINGER_JOINTS.values():
        for name in pair:
            data.joint(name).qpos[0] = 0.5 * joints.GRIPPER_STROKE
    mujoco.mj_forward(model, data)
    return model, data


def _geoms(part: str) -> list[str]:
    return [name + COLLISION_SUFFIX for name in HULLS.get(part, (part,))]


def _mujoco_distance(state: RobotState, pair: tuple[str, str]) -> float:
    model, data = _mujoco(state)
    return min(
        mujoco.mj_geomDistance(model, data, model.geom(a).id, model.geom(b).id, 1.0, None)
        for a, b in product(*map(_geoms, pair))
    )


def test_distances_are_those_of_the_plants_own_geoms() -> None:
    """A hull is never farther off than its geoms, and the same where its edges do not matter."""
    model, seen = RobotModel(), 0
    for state in _states(STATES, seed=31):
        clearance = model.update(state).clearance
        reported = dict(zip(clearance.pairs, clearance.distance, strict=True))
        for pair in PAIRS:
            distance = _mujoco_distance(state, pair)
            if pair not in reported:
                assert distance > REACH - 1e-4
            elif distance > 0.0:
                seen += 1
                hull = any(part in HULLS for part in pair)
                low = -0.05 if hull else -1e-4
                assert low < reported[pair] - distance < 1e-4, pair
    assert seen > 60


def test_rate_and_jacobian_against_differences() -> None:
    """Away from overlap and from edges, where the nearest points jump."""
    seen, far = 0, []
    for state in _states(STATES, seed=32):
        model = RobotModel()
        clearance = model.update(state).clearance

        def distances(direction: Array, length: float) -> dict[tuple[str, str], float]:
            moved = pin.integrate(model.model, state.position, length * direction)
            near = RobotModel().update(RobotState(moved, state.velocity)).clearance
            return dict(zip(near.pairs, near.distance, strict=True))

        ahead, behind = (distances(state.velocity, length) for length in (STEP, -STEP))
        for k, pair in enumerate(clearance.pairs):
            if not (0.002 < clearance.distance[k] < REACH - 0.01):
                continue
            here = clearance.distance[k]
            one, other = (ahead[pair] - here) / STEP, (here - behind[pair]) / STEP
            if abs(one - other) < 1e-2:
                seen += 1
                assert clearance.rate[k] == pytest.approx(0.5 * (one + other), abs=5e-3), pair
    assert seen > 15
