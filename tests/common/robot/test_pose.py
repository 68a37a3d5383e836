"""Poses in space against MuJoCo's rotations, and poses on the floor."""

import math

import mujoco
import numpy as np
import pytest

from common.robot.pose import Pose, Pose2


def tilted() -> Pose:
    quaternion = np.array([0.4, -0.2, 0.8, 0.4])
    return Pose(np.array([1.0, 2.0, 3.0]), quaternion / np.linalg.norm(quaternion))


def test_points_and_poses_go_into_a_frame_and_back() -> None:
    pose, matrix, inside = tilted(), np.zeros(9), np.array([0.3, -0.5, 0.7])
    mujoco.mju_quat2Mat(matrix, pose.quaternion)
    outside = pose.position + matrix.reshape(3, 3) @ inside
    np.testing.assert_allclose(pose.apply(inside), outside, atol=1e-12)
    np.testing.assert_allclose(pose.local(outside), inside, atol=1e-12)
    itself = pose.local_pose(pose)
    np.testing.assert_allclose(itself.position, np.zeros(3), atol=1e-12)
    np.testing.assert_allclose(itself.quaternion, [1.0, 0.0, 0.0, 0.0], atol=1e-12)
    assert pose.yaw == pytest.approx(math.atan2(matrix[3], matrix[0]))


def test_an_upright_pose_has_the_heading_it_was_given() -> None:
    pose = Pose.upright(1.0, 2.0, 0.5, yaw=2.0)
    assert pose.yaw == pytest.approx(2.0)
    np.testing.assert_allclose(pose.apply(np.array([0.0, 0.0, 1.0])), [1.0, 2.0, 1.5])


def test_a_motion_on_the_floor_leads_to_the_pose_it_was_read_from() -> None:
    here, there = Pose2(1.0, -2.0, 3.0), Pose2(0.5, 0.7, -3.0)
    motion = here.to(there)
    assert abs(motion.yaw) < 0.3, "the short way round"
    reached = here.then(motion)
    assert (reached.x, reached.y, reached.yaw) == pytest.approx((there.x, there.y, there.yaw))
    ahead = Pose2(yaw=math.pi / 2).then(Pose2(x=1.0, y=0.2))
    assert (ahead.x, ahead.y) == pytest.approx((-0.2, 1.0))
