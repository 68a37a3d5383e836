import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.robot.kinematics import FORWARD_HAND
from common.robot.pose import Pose
from common.robot.rotations import quaternion_from_rotation_vector, rotation_between
from common.schemas import Setpoint
from common.schemas.arrays import Float64Array as Array
from services.teleop.targets.hand import (
    HandTarget,
    MotionLimits,
    hand_quaternion,
    home_pose,
)
from services.teleop.targets.targets import OperatorTargets

LIMITS = MotionLimits()
DT = 0.05


def test_targets_start_at_the_nominal_hand_pose() -> None:
    # Forward kinematics of the nominal joint positions (see tests of the robot model).
    hands = OperatorTargets().hands
    np.testing.assert_allclose(hands["left"].position, [0.3078, 0.2809996, 0.0459949])
    np.testing.assert_allclose(
        hands["left"].quaternion, [0.683014, 0.183013, -0.683014, -0.183013], atol=1e-5
    )
    np.testing.assert_allclose(
        hands["right"].quaternion, [0.683014, -0.183013, -0.683014, 0.183013], atol=1e-5
    )


def positions(setpoint: Setpoint) -> Array:
    return np.stack([setpoint.left_hand_position_in_body, setpoint.right_hand_position_in_body])


def quaternions(setpoint: Setpoint) -> Array:
    return np.stack([setpoint.left_hand_quaternion_in_body, setpoint.right_hand_quaternion_in_body])


coordinate = st.floats(-1.0, 1.0)
goals = st.lists(
    st.tuples(
        st.sampled_from(["left", "right"]),
        st.tuples(coordinate, coordinate, coordinate),
        st.tuples(*[st.floats(-3.0, 3.0)] * 3),
        st.floats(0.001, 0.1),
        st.integers(1, 12),
    ),
    min_size=1,
    max_size=6,
)


@settings(max_examples=60, deadline=None)
@given(goals)
def test_setpoints_never_exceed_the_speed_limits(goals: list[tuple]) -> None:  # type: ignore[type-arg]
    targets = OperatorTargets()
    before = targets.setpoint(0)
    for side, position, turn, dt, ticks in goals:
        goal = Pose(np.array(position), quaternion_from_rotation_vector(np.array(turn)))
        targets.hands[side].go_to(goal)
        targets.grip(side, position[0])
        targets.look(position[1])
        for _ in range(ticks):
            targets.advance(dt)
            now = targets.setpoint(0)
            moved = np.linalg.norm(positions(now) - positions(before), axis=1)
            assert moved.max() <= LIMITS.linear_speed * dt + 1e-12
            for a, b in zip(quaternions(before), quaternions(now), strict=True):
                assert np.linalg.norm(rotation_between(a, b)) <= LIMITS.angular_speed * dt + 1e-9
                assert a @ b > 0.0
            np.testing.assert_allclose(np.linalg.norm(quaternions(now), axis=1), 1.0, atol=1e-12)
            assert np.abs(now.gripper_closure - before.gripper_closure).max() <= 2.0 * dt + 1e-12
            assert abs(now.neck_pitch - before.neck_pitch) <= 1.0 * dt + 1e-12
            before = now


def test_approach_limits_acceleration_and_settles_without_overshoot() -> None:
    hand = HandTarget("left", LIMITS)
    start = hand.position
    goal = start + np.array([0.15, 0.0, 0.0])
    hand.go_to(Pose(goal, FORWARD_HAND))
    xs = [start[0]]
    for _ in range(80):
        hand.approach(DT)
        xs.append(hand.position[0])
    speed = np.diff(xs) / DT
    assert speed.max() == pytest.approx(LIMITS.linear_speed)
    assert np.abs(np.diff(np.concatenate([[0.0], speed]))).max() / DT <= 2.0 + 1e-9
    assert max(xs) <= goal[0] + 1e-9
    assert xs[-1] == pytest.approx(goal[0], abs=1e-4)
    assert hand.angle < 1e-3


def test_steps_beyond_the_workspace_do_not_pile_up() -> None:
    hand = HandTarget("left", LIMITS)
    for _ in range(200):
        hand.shift(np.array([0.02, 0.0, 0.0]))
        hand.approach(DT)
    assert hand.position[0] == pytest.approx(0.56, abs=1e-4)
    hand.shift(np.array([-0.02, 0.0, 0.0]))
    assert hand.goal_position[0] == pytest.approx(0.54, abs=1e-4)


def test_held_key_leads_by_no_more_than_the_lead() -> None:
    hand = HandTarget("left", LIMITS)
    for _ in range(10):
        hand.shift(np.array([0.02, 0.0, 0.0]))
        hand.turn(np.array([0.0, math.radians(5), 0.0]))
    assert hand.distance == pytest.approx(LIMITS.lead_distance)
    assert hand.angle == pytest.approx(0.4)


def test_a_step_during_a_long_motion_does_not_cut_it_short() -> None:
    hand = HandTarget("left", LIMITS)
    hand.go_to(Pose(np.array([0.5, 0.281, 0.046]), FORWARD_HAND))
    far = hand.distance
    hand.shift(np.array([0.0, 0.0, 0.02]))
    assert hand.distance == pytest.approx(far, rel=1e-6)
    assert hand.goal_position[2] > 0.06


def test_home_is_level_and_mirrored() -> None:
    left, right = home_pose("left"), home_pose("right")
    np.testing.assert_allclose(left.position * [1, -1, 1], right.position)
    np.testing.assert_array_equal(left.quaternion, FORWARD_HAND)


def test_adopted_setpoint_is_published_unchanged() -> None:
    first = OperatorTargets()
    first.hands["left"].place(Pose(np.array([0.4, 0.2, 0.1]), hand_quaternion(0.1, 0.2, 0.3)))
    first.grip("right", 0.7)
    first.look(0.4)
    for _ in range(30):
        first.advance(DT)
    second = OperatorTargets()
    second.adopt(first.setpoint(0))
    second.advance(DT)
    a, b = first.setpoint(9), second.setpoint(9)
    np.testing.assert_allclose(positions(a), positions(b))
    np.testing.assert_allclose(quaternions(a), quaternions(b))
    np.testing.assert_allclose(a.gripper_closure, [0.0, 0.7])
    np.testing.assert_allclose(b.gripper_closure, [0.0, 0.7])
    assert a.neck_pitch == b.neck_pitch == pytest.approx(0.4)
    assert b.header.stamp == 9
