"""Actions: what is encoded for training is decoded again in service."""

import numpy as np
import pytest

from common.robot.rotations import matrix_from_quaternion, rotation_vector_from_matrix
from common.schemas import ControlState
from services.policy.configuration import ChunkConfig
from services.policy.processor.actions import (
    AbsoluteChunks,
    Command,
    PoseDifferences,
    absolute,
    active_frames,
    moving,
)
from tests.services.policy.made import episode


def test_pose_differences_lead_from_set_point_to_set_point() -> None:
    arrays = episode(3)
    hands, neck = arrays["action/hands"], arrays["action/neck"]
    differences = PoseDifferences()
    frames = differences.frames(active_frames(arrays))
    action = differences.encode(hands, neck, frames)

    assert action.shape == (30, 1, 14)
    command = Command(hands[0], 0.4)
    for row, expected in zip(action, hands, strict=True):
        (command,) = differences.decode(row, command)
        np.testing.assert_allclose(command.hands, expected, atol=1e-12)
    assert command.neck == 0.4


def test_a_pose_difference_is_in_the_frame_of_the_previous_set_point() -> None:
    # A hand turned by a quarter about z: its x axis is the body's y axis.
    turned = np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)])
    before = np.concatenate(([0.3, 0.2, 0.1], turned, [0.3, -0.2, 0.1], [1.0, 0.0, 0.0, 0.0]))
    after = before.copy()
    after[[1, 8]] += 0.01
    frames = np.zeros((2, 1), dtype=np.int64)
    action = PoseDifferences().encode(np.stack((before, after)), np.zeros(2), frames)
    np.testing.assert_allclose(action[1, 0, :3], [0.01, 0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(action[1, 0, 7:10], [0.0, 0.01, 0.0], atol=1e-15)
    np.testing.assert_allclose(action[0, 0], [0, 0, 0, 1, 0, 0, 0] * 2, atol=1e-15)


def test_the_sign_of_a_quaternion_makes_no_other_difference() -> None:
    hands = episode(1)["action/hands"]
    flipped = hands.copy()
    flipped[1::2, 3:7] *= -1.0
    encode, frames = PoseDifferences().encode, np.zeros((30, 1), dtype=np.int64)
    np.testing.assert_array_equal(
        encode(flipped, np.zeros(30), frames), encode(hands, np.zeros(30), frames)
    )


def test_a_decoded_set_point_has_a_unit_quaternion_and_stays_in_the_workspace() -> None:
    hands = episode(2)["action/hands"][0]
    wild = np.full((1, 14), 3.0)
    (command,) = PoseDifferences().decode(wild, Command(hands, 0.0))
    assert np.linalg.norm(command.hands[3:7]) == pytest.approx(1.0, abs=1e-12)
    assert command.hands[0] <= 0.56
    assert command.hands[2] <= 0.40


@pytest.mark.parametrize("active_time", [False, True])
def test_chunks_hold_the_set_points_that_follow(active_time: bool) -> None:
    arrays = episode(4)
    hands, neck = arrays["action/hands"], arrays["action/neck"]
    chunks = AbsoluteChunks(ChunkConfig(steps=5, active_time=active_time))
    frames = chunks.frames(active_frames(arrays))
    action = chunks.encode(hands, neck, frames)

    assert action.shape == (30, 5, 13)
    np.testing.assert_array_equal(frames[10], [10, 11, 12, 13, 14])
    np.testing.assert_array_equal(frames[28, 2:], [29, 29, 29])
    for step, command in enumerate(chunks.decode(action[10], Command(hands[0], 0.0))):
        np.testing.assert_allclose(command.hands, hands[10 + step], atol=1e-12)
        assert command.neck == pytest.approx(neck[10 + step], abs=1e-15)


def test_active_time_leaves_out_the_frames_in_which_nothing_moves() -> None:
    moves = episode(5, frames=20)["action/hands"]
    # A pause of two seconds after the tenth frame.
    hands = np.concatenate((moves[:10], np.repeat(moves[9:10], 40, axis=0), moves[10:]))
    grasp = np.zeros((60, 2))
    grasp[30:] = 1.0
    columns = {
        "action/hands": hands,
        "action/grasp": grasp,
        "observation/control_state": np.full(60, int(ControlState.BALANCE)),
    }
    active = np.flatnonzero(moving(hands, grasp))
    np.testing.assert_array_equal(np.flatnonzero(active_frames(columns)), active)
    # Judged over the last 0.3 s, six frames: in the pause only the gripper moves.
    np.testing.assert_array_equal(active[(active > 15) & (active < 50)], np.arange(30, 36))
    assert {8, 9, 10} <= set(active.tolist())

    frames = AbsoluteChunks(ChunkConfig(steps=8)).frames(active_frames(columns))
    np.testing.assert_array_equal(frames[20, :6], np.arange(30, 36))
    # Out of the pause the labels lead away from it at once.
    assert frames[40, 0] == frames[20, 6] >= 50
    assert np.linalg.norm(hands[frames[40, 0]] - hands[40]) > 0.005


def test_a_hand_that_is_knocked_away_is_no_example_but_its_way_back_is() -> None:
    arrays = episode(7)
    slips = np.zeros(30)
    slips[10:15] = 1.0
    frames = AbsoluteChunks(ChunkConfig(steps=4)).frames(
        active_frames(arrays | {"action/slip": slips})
    )
    np.testing.assert_array_equal(frames[8], [8, 9, 15, 16])
    np.testing.assert_array_equal(frames[12], [15, 16, 17, 18])
    # Older files have no such column; it is read as NaN.
    np.testing.assert_array_equal(
        active_frames(arrays | {"action/slip": np.full(30, np.nan)}), active_frames(arrays)
    )


def test_hands_stay_closed_while_the_robot_walks() -> None:
    # Hands that rest all the time, closed from frame 10 to 49; the robot walks from 20 to 39.
    hands = np.repeat(episode(5)["action/hands"][:1], 60, axis=0)
    grasp = np.zeros((60, 2))
    grasp[10:50] = 1.0
    state = np.full(60, int(ControlState.BALANCE))
    state[20:40] = ControlState.LF_SWING
    columns = {
        "action/hands": hands,
        "action/grasp": grasp,
        "observation/control_state": state,
    }
    frames = AbsoluteChunks(ChunkConfig(steps=8)).frames(active_frames(columns))
    # What follows the grasp is the walk, not the opening at its end, which comes after it.
    np.testing.assert_array_equal(frames[16], np.arange(20, 28))
    np.testing.assert_array_equal(frames[40, :6], np.arange(50, 56))
    assert grasp[frames[10:33]].all()


def test_absolute_poses_are_rotation_vectors_about_the_axes_of_the_body() -> None:
    arrays = episode(6)
    row = absolute(arrays["action/hands"])[20]
    forward, hand = (
        matrix_from_quaternion(q)
        for q in (np.array([0.5, 0.0, -0.5, 0.0]), arrays["action/hands"][20, 3:7])
    )
    np.testing.assert_allclose(row[3:6], rotation_vector_from_matrix(hand @ forward.T), atol=1e-9)
    np.testing.assert_array_equal(row[6:9], arrays["action/hands"][20, 7:10])
