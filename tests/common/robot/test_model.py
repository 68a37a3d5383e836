"""What the file says: masses, frames, limits, couplings, geoms."""

from typing import Any

import mujoco
import numpy as np
import pytest

from common.robot import frames, joints


def test_total_mass_is_the_plain_urdf_with_hands(mj_model: Any, pin_model: Any) -> None:
    assert mj_model.body_mass.sum() == pytest.approx(36.5222, abs=1e-3)
    assert sum(i.mass for i in pin_model.inertias) == pytest.approx(36.5222, abs=1e-3)


@pytest.mark.parametrize("side", ["l", "r"])
def test_each_hand_weighs_gripper_mount_palm_and_fingers(mj_model: Any, side: str) -> None:
    bodies = ("wrist_pitch", "finger_a", "finger_b")
    mass = sum(mj_model.body(f"{side}_{name}_link").mass[0] for name in bodies)
    assert mass == pytest.approx(0.145 + 0.4, abs=1e-9)


def test_corrected_knee_carrier_is_a_possible_rigid_body(mj_model: Any) -> None:
    left, right = (mj_model.body(f"{s}_knee_fe_lp").inertia for s in "lr")
    assert right == pytest.approx(left, rel=0.12)  # its largest was 0.00145, 60 % above the left's


def test_nominal_frames_match_the_public_model(nominal: Any) -> None:
    assert nominal.site("l_foot").xpos == pytest.approx([0.05374, 0.14597, 0.00316], abs=1e-5)
    assert nominal.site("r_foot").xpos == pytest.approx([0.05374, -0.14598, 0.00316], abs=2e-5)
    assert nominal.site("l_hand").xpos == pytest.approx([0.3078, 0.2810, 0.7890], abs=1e-5)
    assert nominal.site("r_hand").xpos == pytest.approx([0.3078, -0.2810, 0.7890], abs=1e-5)
    for name in frames.FOOT_FRAMES.values():
        assert nominal.site(name).xmat == pytest.approx(np.eye(3).ravel(), abs=1e-5)


def test_nominal_hand_constant_is_the_forward_kinematics(nominal: Any) -> None:
    torso = nominal.body(frames.BODY_FRAME).xpos
    for side, name in frames.HAND_FRAMES.items():
        expected = frames.NOMINAL_HAND_IN_BODY[side]
        assert nominal.site(name).xpos - torso == pytest.approx(expected, abs=1e-6)


def test_forward_hand_orientation_points_ahead_and_opens_sideways() -> None:
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, np.array(frames.FORWARD_HAND_IN_BODY))
    matrix = rotation.reshape(3, 3)
    assert -matrix[:, 2] == pytest.approx([1, 0, 0], abs=1e-12)
    assert matrix[:, 1] == pytest.approx([0, 1, 0], abs=1e-12)


def test_zero_pose_stands_910_mm_above_its_soles(mj_model: Any) -> None:
    data = mujoco.MjData(mj_model)
    mujoco.mj_kinematics(mj_model, data)
    drop = data.body(frames.BODY_FRAME).xpos[2] - data.site("l_foot").xpos[2]
    assert drop == pytest.approx(0.910, abs=5e-4)


def test_both_libraries_keep_the_canonical_order(mj_model: Any, pin_model: Any) -> None:
    names = [mj_model.joint(i).name for i in range(mj_model.njnt)]
    assert names == list(pin_model.names)[1:]
    fingers = {finger for pair in joints.FINGER_JOINTS.values() for finger in pair}
    assert names[0] == frames.BASE_JOINT
    assert tuple(n for n in names[1:] if n not in fingers) == joints.JOINT_NAMES
    assert len(names) == 1 + joints.NUM_JOINTS + len(fingers)


def test_every_named_frame_exists_in_both(mj_model: Any, pin_model: Any) -> None:
    sites = [*frames.FOOT_FRAMES.values(), *frames.HAND_FRAMES.values()]
    for name in (*sites, frames.BASE_COM_FRAME, frames.IMU_FRAME):
        assert mj_model.site(name).name == name
        assert pin_model.existFrame(name)
    for name in (frames.BODY_FRAME, frames.HEAD_FRAME):
        assert mj_model.body(name).name == name
        assert pin_model.existFrame(name)
    assert mj_model.site(frames.BASE_COM_FRAME).pos[2] == frames.BASE_COM_HEIGHT


def test_limits_in_the_file_are_those_of_the_table(mj_model: Any) -> None:
    for i, spec in enumerate(joints.JOINTS):
        joint = mj_model.joint(spec.name)
        assert tuple(joint.range) == (spec.lower, spec.upper)
        assert mj_model.jnt_limited[joint.id]
        assert not mj_model.jnt_actfrclimited[joint.id]
        assert joint.armature[0] == joints.ARMATURE
        assert joint.damping[0] == joint.frictionloss[0] == 0.0
        assert joints.POSITION_LOWER[i] <= joints.NOMINAL_POSITION[i] <= joints.POSITION_UPPER[i]


def test_motor_ranges_are_the_relaxed_efforts(mj_model: Any) -> None:
    for motor in joints.MOTORS:
        limit = joints.EFFORT_RELAXED[joints.JOINT_INDEX[motor.joints[-1]]]
        assert tuple(mj_model.actuator(motor.name).ctrlrange) == (-limit, limit)
    margin = joints.EFFORT_RELAXED - joints.EFFORT_RATED
    assert margin == pytest.approx(np.repeat([200.0, 0.0], [14, 13]), abs=1e-12)
    names = [mj_model.actuator(i).name for i in range(mj_model.nu)]
    assert tuple(names) == (*joints.MOTOR_NAMES, *joints.GRIPPER_ACTUATORS.values())


def test_groups_partition_the_joints() -> None:
    groups = (
        joints.LEFT_LEG,
        joints.RIGHT_LEG,
        joints.LEFT_ARM,
        joints.RIGHT_ARM,
        joints.NECK,
    )
    assert [g.stop - g.start for g in groups] == [7, 7, 6, 6, 1]
    covered = [i for g in groups for i in range(g.start, g.stop)]
    assert covered == list(range(joints.NUM_JOINTS))
    assert all(name.startswith("l_") for name in joints.JOINT_NAMES[joints.LEFT_ARM])


def test_motor_matrix_carries_knee_torque_twice() -> None:
    gram = joints.MOTOR_TO_JOINT.T @ joints.MOTOR_TO_JOINT
    knees = [joints.MOTOR_NAMES.index(name) for name in ("l_knee", "r_knee")]
    expected = np.ones(joints.NUM_MOTORS)
    expected[knees] = 2.0
    assert np.array_equal(gram, np.diag(expected))
    coordinate = joints.NOMINAL_POSITION[list(joints.MOTOR_POSITION_INDEX)]
    assert np.array_equal(joints.MOTOR_TO_JOINT @ coordinate, joints.NOMINAL_POSITION)


def test_tables_cannot_be_written() -> None:
    with pytest.raises(ValueError, match="read-only"):
        joints.NOMINAL_POSITION[0] = 1.0
