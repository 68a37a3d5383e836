"""Feet and hands where pinocchio and MuJoCo have them, without either library."""

import subprocess
import sys
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from common.robot.frames import BODY_FRAME, FOOT_FRAMES, HAND_FRAMES
from common.robot.joints import JOINT_NAMES, NOMINAL_POSITION, POSITION_LOWER, POSITION_UPPER
from common.robot.kinematics import (
    FLAT_FOOT,
    FORWARD_HAND,
    KinematicsError,
    end_effector_poses,
    foot_in_body,
    hand_in_body,
)
from common.robot.pose import Pose
from common.robot.rotations import matrix_from_quaternion, rotation_vector_from_matrix

SITES = (*FOOT_FRAMES.values(), *HAND_FRAMES.values())


@pytest.mark.parametrize("seed", range(20))
def test_poses_are_pinocchios(pin_model: Any, seed: int) -> None:
    joints = np.random.default_rng(seed).uniform(POSITION_LOWER, POSITION_UPPER)
    q = pin.neutral(pin_model)
    for name, value in zip(JOINT_NAMES, joints, strict=True):
        q[pin_model.joints[pin_model.getJointId(name)].idx_q] = value
    data = pin_model.createData()
    pin.framesForwardKinematics(pin_model, data, q)
    torso = data.oMf[pin_model.getFrameId(BODY_FRAME)]
    found = end_effector_poses(joints).reshape(4, 7)
    for site, (position, quaternion) in zip(SITES, ((f[:3], f[3:]) for f in found), strict=True):
        expected = torso.inverse() * data.oMf[pin_model.getFrameId(site)]
        assert np.abs(position - expected.translation).max() <= 1e-9
        off = matrix_from_quaternion(quaternion) @ expected.rotation.T
        assert np.linalg.norm(rotation_vector_from_matrix(off)) <= 1e-9


@pytest.mark.parametrize("seed", range(5))
def test_poses_are_mujocos(mj_model: Any, seed: int) -> None:
    data, rng = mujoco.MjData(mj_model), np.random.default_rng(seed)
    joints = rng.uniform(POSITION_LOWER, POSITION_UPPER)
    for name, value in zip(JOINT_NAMES, joints, strict=True):
        data.joint(name).qpos[:] = value
    data.joint("base").qpos[:] = [*rng.normal(size=3), 0.5, 0.5, -0.5, 0.5]
    mujoco.mj_kinematics(mj_model, data)
    torso = Pose(data.body(BODY_FRAME).xpos, data.body(BODY_FRAME).xquat)
    for side in ("left", "right"):
        for pose, site in (
            (foot_in_body(side, joints), data.site(FOOT_FRAMES[side])),
            (hand_in_body(side, joints), data.site(HAND_FRAMES[side])),
        ):
            np.testing.assert_allclose(torso.apply(pose.position), site.xpos, atol=1e-9)
            rotation = matrix_from_quaternion(torso.quaternion) @ matrix_from_quaternion(
                pose.quaternion
            )
            np.testing.assert_allclose(rotation, site.xmat.reshape(3, 3), atol=1e-9)


def test_quaternions_keep_the_sign_of_the_usual_orientation() -> None:
    for joints in np.random.default_rng(1).uniform(POSITION_LOWER, POSITION_UPPER, (50, 27)):
        quaternions = end_effector_poses(joints).reshape(4, 7)[:, 3:]
        assert (quaternions[:2] @ FLAT_FOOT >= 0.0).all()
        assert (quaternions[2:] @ FORWARD_HAND >= 0.0).all()
        np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1.0, atol=1e-12)


def test_a_site_that_is_not_there_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("common.robot.kinematics.HAND_FRAMES", {"left": "third_hand"})
    with pytest.raises(KinematicsError, match="third_hand"):
        hand_in_body("left", NOMINAL_POSITION)


def test_it_needs_neither_pinocchio_nor_mujoco() -> None:
    program = (
        "import sys; sys.modules.update(pinocchio=None, mujoco=None, scipy=None)\n"
        "from common.robot.joints import NOMINAL_POSITION\n"
        "from common.robot.kinematics import end_effector_poses\n"
        "assert end_effector_poses(NOMINAL_POSITION).shape == (28,)"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)
