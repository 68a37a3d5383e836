import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.robot.rotations import (
    Array,
    from_rotation_vector,
    from_rpy,
    multiply,
    normalised,
    rotate,
    rotation_vector,
)
from services.teleop.targets.hand import FORWARD_HAND, hand_quaternion

angles = st.floats(-3.0, 3.0)
vectors = st.tuples(angles, angles, angles).map(np.array)


def matrix(quaternion: Array) -> Array:
    columns = [
        multiply(multiply(quaternion, np.concatenate([[0.0], axis])), quaternion * [1, -1, -1, -1])[
            1:
        ]
        for axis in np.eye(3)
    ]
    return np.column_stack(columns)


def test_forward_hand_points_its_minus_z_ahead() -> None:
    expected = np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]])
    np.testing.assert_allclose(matrix(FORWARD_HAND), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("rpy", "ahead"),
    [
        ((0.0, 0.3, 0.0), (math.cos(0.3), 0.0, -math.sin(0.3))),
        ((0.0, 0.0, 0.3), (math.cos(0.3), math.sin(0.3), 0.0)),
        ((0.7, 0.0, 0.0), (1.0, 0.0, 0.0)),
    ],
)
def test_pitch_points_down_yaw_left_and_roll_keeps_the_direction(
    rpy: tuple[float, float, float], ahead: tuple[float, float, float]
) -> None:
    np.testing.assert_allclose(-matrix(hand_quaternion(*rpy))[:, 2], ahead, atol=1e-12)


def test_rpy_turns_about_fixed_axes_x_first() -> None:
    def about(axis: int, angle: float) -> Array:
        return matrix(from_rotation_vector(angle * np.eye(3)[axis]))

    expected = about(2, 0.5) @ about(1, -0.4) @ about(0, 1.1)
    np.testing.assert_allclose(matrix(from_rpy(1.1, -0.4, 0.5)), expected, atol=1e-12)


@given(vectors, vectors)
def test_rotation_vector_inverts_rotate(start: Array, turn: Array) -> None:
    quaternion = from_rotation_vector(start)
    angle = float(np.linalg.norm(turn))
    if angle > 3.0:
        turn = turn * (3.0 / angle)
    np.testing.assert_allclose(
        rotation_vector(quaternion, rotate(quaternion, turn)), turn, atol=1e-9
    )


@given(vectors, vectors)
def test_rotation_vector_is_the_shortest_whatever_the_signs(a: Array, b: Array) -> None:
    start, end = from_rotation_vector(a), from_rotation_vector(b)
    turn = rotation_vector(start, end)
    assert np.linalg.norm(turn) <= math.pi + 1e-9
    np.testing.assert_allclose(matrix(rotate(start, turn)), matrix(end), atol=1e-9)
    np.testing.assert_allclose(
        matrix(rotate(start, rotation_vector(start, -end))), matrix(end), atol=1e-9
    )


def test_rotate_stays_on_one_side_of_the_sphere_through_a_full_turn() -> None:
    quaternion = start = normalised(np.array([0.3, 0.2, -0.8, 0.1]))
    for _ in range(100):
        following = rotate(quaternion, np.array([0.0, 0.0, 2 * math.pi / 100]))
        assert following @ quaternion > 0.99
        quaternion = following
    np.testing.assert_allclose(quaternion, -start, atol=1e-9)
