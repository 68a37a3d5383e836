from math import pi

import numpy as np
import pytest

from common.episodes.errors import EpisodeError
from common.episodes.oracle import oracle_names, oracle_numbers
from common.robot.pose import Pose
from common.robot.rotations import multiply
from common.schemas import PlantState, SceneJoint, ScenePose, SceneState

NAMES = ("grip.x", "grip.y", "grip.z", "grip.sin_yaw", "grip.cos_yaw")


def plant_state(base: Pose) -> PlantState:
    q = np.zeros(27)
    return PlantState(
        base_position=base.position,
        base_quaternion=base.quaternion,
        base_linear_velocity=np.zeros(3),
        base_angular_velocity=np.zeros(3),
        joint_position=q,
        joint_velocity=q,
        joint_torque=q,
        gripper_closure=np.zeros(2),
        foot_normal_force=np.zeros(2),
    )


def scene_state() -> SceneState:
    grip, goal = Pose.upright(1.0, 2.0, 0.9, yaw=pi / 2), Pose.upright(0.0, 0.0)
    return SceneState(
        scene="door",
        task="door/unlock",
        objects=[ScenePose(name="grip", position=grip.position, quaternion=grip.quaternion)],
        joints=[SceneJoint(name="hinge", position=0.2), SceneJoint(name="latch", position=0.01)],
        marks=[ScenePose(name="goal", position=goal.position, quaternion=goal.quaternion)],
    )


def test_an_object_is_seen_from_the_torso() -> None:
    # The torso stands at (1, 1), turned to the left: the grip is a metre ahead, and points ahead.
    state = plant_state(Pose.upright(1.0, 1.0, 0.7, yaw=pi / 2))
    np.testing.assert_allclose(
        oracle_numbers(NAMES, state, scene_state()), [1.0, 0.0, 0.2, 0.0, 1.0], atol=1e-12
    )


def test_yaw_grows_to_the_left() -> None:
    numbers = oracle_numbers(NAMES[3:], plant_state(Pose.upright(0.0, 0.0)), scene_state())
    np.testing.assert_allclose(numbers, [1.0, 0.0], atol=1e-12)


def test_numbers_do_not_change_when_robot_and_scene_move_together() -> None:
    base, move = Pose.upright(0.3, -0.4, 0.7, yaw=0.3), Pose.upright(2.0, 1.0, 0.0, yaw=-1.1)

    def moved(pose: Pose) -> Pose:
        return Pose(move.apply(pose.position), multiply(move.quaternion, pose.quaternion))

    scene = scene_state()
    elsewhere = [moved(Pose(o.position, o.quaternion)) for o in (*scene.objects, *scene.marks)]
    parts = [
        ScenePose(name=n, position=p.position, quaternion=p.quaternion)
        for n, p in zip(("grip", "goal"), elsewhere, strict=True)
    ]
    other = scene.model_copy(update={"objects": parts[:1], "marks": parts[1:]})
    names = oracle_names(scene)
    np.testing.assert_allclose(
        oracle_numbers(names, plant_state(moved(base)), other),
        oracle_numbers(names, plant_state(base), scene),
        atol=1e-12,
    )


def test_names_cover_objects_marks_and_joints_in_any_order() -> None:
    scene, state = scene_state(), plant_state(Pose.upright(0.0, 0.0))
    names = oracle_names(scene)
    assert names == (*NAMES, *(n.replace("grip", "goal") for n in NAMES), "hinge", "latch")
    assert oracle_numbers(("latch", "grip.y", "hinge"), state, scene).tolist() == [0.01, 2.0, 0.2]


def test_what_the_scene_does_not_have_is_named() -> None:
    with pytest.raises(EpisodeError, match=r"to have hammer\.x, it has grip\.x"):
        oracle_numbers(("hammer.x", "hinge"), plant_state(Pose.upright(0.0, 0.0)), scene_state())
