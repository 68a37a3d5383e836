"""Feet and hands where pinocchio and MuJoCo have them, without either library."""

import subprocess
import sys
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from common.robot.frames import BODY_FRAME, FOOT_FRAMES, HAND_FRAMES
from common.robot.joints import (
    JOINT_NAMES,
    LEFT_LEG,
    MOTOR_TO_JOINT,
    NOMINAL_POSITION,
    NUM_MOTORS,
    POSITION_LOWER,
    POSITION_UPPER,
    RIGHT_LEG,
)
from common.robot.kinematics import (
    FLAT_FOOT,
    FORWARD_HAND,
    KinematicsError,
    end_effector_poses,
    foot_in_body,
    hand_in_body,
    leg_reaching,
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


@pytest.mark.parametrize(("side", "leg"), [("left", LEFT_LEG), ("right", RIGHT_LEG)])
@pytest.mark.parametrize("seed", range(5))
def test_a_leg_reaches_the_pose_of_a_step_and_nothing_else_moves(
    side: str, leg: slice, seed: int
) -> None:
    turns = MOTOR_TO_JOINT @ np.random.default_rng(seed).uniform(-0.15, 0.15, NUM_MOTORS)
    goal = foot_in_body(side, NOMINAL_POSITION + turns)
    found = leg_reaching(side, goal, NOMINAL_POSITION)
    pose = foot_in_body(side, found)
    assert np.linalg.norm(pose.position - goal.position) < 1e-6
    assert abs(pose.quaternion @ goal.quaternion) == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(found[leg], (NOMINAL_POSITION + turns)[leg], atol=1e-5)
    np.testing.assert_array_equal(np.delete(found, leg), np.delete(NOMINAL_POSITION, leg))


def test_a_leg_out_of_reach_stretches_within_its_limits() -> None:
    pose = foot_in_body("left", NOMINAL_POSITION)
    goal = Pose(pose.position - np.array([0.0, 0.0, 0.5]), pose.quaternion)
    found = leg_reaching("left", goal, NOMINAL_POSITION)
    assert (found >= POSITION_LOWER).all()
    assert (found <= POSITION_UPPER).all()
    assert goal.position[2] < foot_in_body("left", found).position[2] < pose.position[2] - 0.02


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
