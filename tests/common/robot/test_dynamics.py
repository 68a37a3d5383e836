"""MuJoCo and pinocchio read the same file: same mass matrix, bias, frames and Jacobians."""

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from common.robot import frames

from .support import Array, base_rotation, body_from_pin, pin_configuration

STATES = 60
TOLERANCE = 1e-9  # relative; the comparison is of two double-precision recursions
SITES = (*frames.FOOT_FRAMES.values(), *frames.HAND_FRAMES.values(), frames.BASE_COM_FRAME)


def _states(model: Any) -> Iterator[Any]:
    """MuJoCo data at seeded random states: any base pose and twist, joints within their limits."""
    rng = np.random.default_rng(20230925)
    data = mujoco.MjData(model)
    for _ in range(STATES):
        quaternion = rng.normal(size=4)
        data.qpos[:3] = rng.uniform(-2, 2, 3)
        data.qpos[3:7] = quaternion / np.linalg.norm(quaternion)
        data.qpos[7:] = rng.uniform(model.jnt_range[1:, 0], model.jnt_range[1:, 1])
        data.qvel[:] = rng.normal(size=model.nv) * 2.0
        mujoco.mj_forward(model, data)
        yield data


def _relative(a: Array, b: Array) -> float:
    return float(np.abs(a - b).max() / np.abs(b).max())


def _mujoco_mass(model: Any, data: Any) -> Array:
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    return mass


def _pin_mass(model: Any, q: Array) -> Array:
    upper: Array = np.triu(pin.crba(model, model.createData(), q))
    return upper + np.triu(upper, 1).T


def test_mass_matrices_agree(mj_model: Any, pin_model: Any) -> None:
    for data in _states(mj_model):
        T = body_from_pin(base_rotation(data.qpos), mj_model.nv)
        expected = T.T @ _mujoco_mass(mj_model, data) @ T
        assert _relative(_pin_mass(pin_model, pin_configuration(data.qpos)), expected) < TOLERANCE


def test_pinocchio_counts_the_armature_itself(mj_model: Any, pin_model: Any) -> None:
    """The controller must not add the rotor inertia a second time."""
    assert np.array_equal(pin_model.armature, mj_model.dof_armature)
    bare = pin_model.copy()
    bare.armature = np.zeros(pin_model.nv)
    q = pin.neutral(pin_model)
    difference = _pin_mass(pin_model, q) - _pin_mass(bare, q)
    assert difference == pytest.approx(np.diag(mj_model.dof_armature), abs=1e-12)


def test_bias_forces_agree(mj_model: Any, pin_model: Any) -> None:
    """Gravity, centrifugal and Coriolis; the base's body acceleration differs by v x w."""
    pin_data = pin_model.createData()
    for data in _states(mj_model):
        rotation = base_rotation(data.qpos)
        T = body_from_pin(rotation, mj_model.nv)
        q, v = pin_configuration(data.qpos), T.T @ data.qvel
        spatial = np.zeros(mj_model.nv)
        spatial[:3] = np.cross(v[3:6], v[:3])
        expected = T.T @ (data.qfrc_bias + _mujoco_mass(mj_model, data) @ T @ spatial)
        assert _relative(pin.nle(pin_model, pin_data, q, v), expected) < TOLERANCE


def test_frame_poses_agree(mj_model: Any, pin_model: Any) -> None:
    pin_data = pin_model.createData()
    bodies = [mj_model.body(i).name for i in range(1, mj_model.nbody)]
    for data in _states(mj_model):
        pin.framesForwardKinematics(pin_model, pin_data, pin_configuration(data.qpos))
        views = [(name, data.body(name)) for name in bodies]
        for name, view in [*views, *((name, data.site(name)) for name in SITES)]:
            pose = pin_data.oMf[pin_model.getFrameId(name)]
            assert np.abs(pose.translation - view.xpos).max() < TOLERANCE
            assert np.abs(pose.rotation.ravel() - view.xmat).max() < TOLERANCE


def test_frame_jacobians_agree(mj_model: Any, pin_model: Any) -> None:
    pin_data = pin_model.createData()
    jacobian = np.zeros((6, mj_model.nv))
    for data in _states(mj_model):
        T = body_from_pin(base_rotation(data.qpos), mj_model.nv)
        pin.computeJointJacobians(pin_model, pin_data, pin_configuration(data.qpos))
        pin.updateFramePlacements(pin_model, pin_data)
        for name in SITES:
            site = mj_model.site(name).id
            mujoco.mj_jacSite(mj_model, data, jacobian[:3], jacobian[3:], site)
            frame = pin_model.getFrameId(name)
            aligned = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
            actual = pin.getFrameJacobian(pin_model, pin_data, frame, aligned)
            assert _relative(actual, jacobian @ T) < TOLERANCE


def test_centre_of_mass_agrees(mj_model: Any, pin_model: Any) -> None:
    pin_data = pin_model.createData()
    for data in _states(mj_model):
        com = pin.centerOfMass(pin_model, pin_data, pin_configuration(data.qpos))
        assert com == pytest.approx(data.subtree_com[1], abs=TOLERANCE)
