"""Rotations against scipy's, with the corners near zero and near half a turn."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from common.robot.kinematics import FORWARD_HAND
from common.robot.rotations import (
    clamp_norm,
    conjugate,
    matrix_from_quaternion,
    matrix_from_rotation_vector,
    matrix_from_yaw,
    multiply,
    nearer_sign,
    normalised,
    quaternion_from_rotation_vector,
    quaternion_from_rpy,
    rotate,
    rotate_about_z,
    rotate_vector,
    rotation_between,
    rotation_vector_from_matrix,
    rpy_from_quaternion,
    wrap_angle,
    yaw_from_matrix,
    yaw_from_quaternion,
)
from common.schemas.arrays import Float64Array as Array
from services.teleop.targets.hand import hand_quaternion

component = st.floats(-3.0, 3.0)
vectors = st.tuples(component, component, component).map(np.array)
unit = st.floats(-1.0, 1.0)
angles = st.floats(0.0, np.pi - 2e-3)
quick = settings(max_examples=200, deadline=None, derandomize=True)


@st.composite
def axes(draw: st.DrawFn) -> Array:
    vector = np.array([draw(unit), draw(unit), draw(unit)])
    norm = float(np.linalg.norm(vector))
    return vector / norm if norm > 1e-3 else np.array([0.0, 0.0, 1.0])


@quick
@given(axes(), angles)
def test_exponential_is_that_of_scipy(axis: Array, angle: float) -> None:
    expected = Rotation.from_rotvec(angle * axis).as_matrix()
    assert np.abs(matrix_from_rotation_vector(angle * axis) - expected).max() < 1e-14


@quick
@given(axes(), angles)
def test_logarithm_undoes_the_exponential(axis: Array, angle: float) -> None:
    vector = rotation_vector_from_matrix(matrix_from_rotation_vector(angle * axis))
    # Just below a half turn the skew part, sin(angle), has lost three digits.
    assert np.abs(vector - angle * axis).max() < 1e-12


@quick
@given(axes(), st.floats(-14.0, -5.0))
def test_small_rotations_keep_their_relative_precision(axis: Array, exponent: float) -> None:
    angle = 10.0**exponent
    vector = rotation_vector_from_matrix(matrix_from_rotation_vector(angle * axis))
    assert np.abs(vector - angle * axis).max() < 1e-9 * angle


@pytest.mark.parametrize("short", [0.0, 1e-12, 1e-9, 1e-6, 1e-5, 1e-4, 1e-3, 1.41e-3, 1.42e-3])
def test_angle_is_exact_near_half_a_turn(short: float) -> None:
    for axis in np.random.default_rng(1).normal(size=(50, 3)):
        expected = (np.pi - short) * axis / np.linalg.norm(axis)
        vector = rotation_vector_from_matrix(matrix_from_rotation_vector(expected))
        # acos loses half its digits near -1.
        assert abs(np.linalg.norm(vector) - (np.pi - short)) < 5e-8
        if short > 1e-6:
            # Not the long way round.
            assert np.abs(vector - expected).max() < 0.01


@pytest.mark.parametrize("short", [1e-6, 1e-5, 1e-4, 1e-3, 1.41e-3])
def test_logarithm_just_below_half_a_turn_gives_the_rotation_back(short: float) -> None:
    _assert_round_trip(short)


@pytest.mark.parametrize("short", [0.0, 1e-12, 1e-9, 1.42e-3])
def test_logarithm_near_half_a_turn_gives_the_rotation_back(short: float) -> None:
    _assert_round_trip(short)


def _assert_round_trip(short: float) -> None:
    for axis in np.random.default_rng(2).normal(size=(50, 3)):
        matrix = matrix_from_rotation_vector((np.pi - short) * axis / np.linalg.norm(axis))
        again = matrix_from_rotation_vector(rotation_vector_from_matrix(matrix))
        assert np.abs(again - matrix).max() < 1e-7


@pytest.mark.parametrize("axis", np.vstack((np.eye(3), -np.eye(3))))
def test_half_turns_about_the_axes(axis: Array) -> None:
    # diag(-1, -1, 1) and the like have no skew part at all; which of the two ends is free.
    matrix = 2.0 * np.outer(axis, axis) - np.eye(3)
    vector = rotation_vector_from_matrix(matrix)
    assert np.abs(np.abs(vector) - np.pi * np.abs(axis)).max() < 1e-12


@quick
@given(axes(), angles, st.floats(0.5, 2.0))
def test_quaternions_of_any_length_become_rotations(
    axis: Array, angle: float, scale: float
) -> None:
    rotation = Rotation.from_rotvec(angle * axis)
    quaternion = rotation.as_quat(canonical=True, scalar_first=True)
    for sign in (1.0, -1.0):
        matrix = matrix_from_quaternion(sign * scale * quaternion)
        assert np.abs(matrix - rotation.as_matrix()).max() < 1e-12


@quick
@given(st.floats(-20.0, 20.0))
def test_wrapping_keeps_the_direction(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -np.pi <= wrapped <= np.pi
    assert abs(np.exp(1j * wrapped) - np.exp(1j * angle)) < 1e-13


@quick
@given(st.floats(-3.14, 3.14), st.floats(-0.6, 0.6), st.floats(-0.6, 0.6))
def test_yaw_is_the_heading_of_the_x_axis(yaw: float, pitch: float, roll: float) -> None:
    # Lifting the nose and rolling about it leave the heading alone.
    tilted = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()
    assert abs(yaw_from_matrix(tilted) - yaw) < 1e-13
    assert abs(yaw_from_matrix(matrix_from_yaw(yaw)) - yaw) < 1e-15


@quick
@given(vectors, vectors)
def test_a_quaternion_rotates_as_its_matrix_does(rotation: Array, vector: Array) -> None:
    quaternion = quaternion_from_rotation_vector(rotation)
    matrix = matrix_from_rotation_vector(rotation)
    np.testing.assert_allclose(matrix_from_quaternion(quaternion), matrix, atol=1e-12)
    np.testing.assert_allclose(rotate_vector(quaternion, vector), matrix @ vector, atol=1e-12)
    back = rotate_vector(conjugate(quaternion), matrix @ vector)
    np.testing.assert_allclose(back, vector, atol=1e-12)
    assert yaw_from_quaternion(quaternion) == pytest.approx(yaw_from_matrix(matrix), abs=1e-9)


@quick
@given(vectors, vectors)
def test_the_right_factor_of_a_product_rotates_first(a: Array, b: Array) -> None:
    product = multiply(quaternion_from_rotation_vector(a), quaternion_from_rotation_vector(b))
    expected = matrix_from_rotation_vector(a) @ matrix_from_rotation_vector(b)
    np.testing.assert_allclose(matrix_from_quaternion(product), expected, atol=1e-12)


@quick
@given(component, st.floats(-1.5, 1.5), component)
def test_roll_pitch_yaw_are_read_back(roll: float, pitch: float, yaw: float) -> None:
    quaternion = quaternion_from_rpy(roll, pitch, yaw)
    np.testing.assert_allclose(rpy_from_quaternion(quaternion), (roll, pitch, yaw), atol=1e-9)


def test_a_rotation_about_z_leaves_the_height() -> None:
    turned = rotate_about_z(np.array([1.0, 2.0, 3.0]), 0.5)
    np.testing.assert_allclose(turned, matrix_from_yaw(0.5) @ [1.0, 2.0, 3.0], atol=1e-15)


def test_the_sign_nearer_to_a_reference_is_taken() -> None:
    reference = np.array([1.0, 0.0, 0.0, 0.0])
    quaternion = np.array([-0.8, 0.6, 0.0, 0.0])
    assert nearer_sign(quaternion, reference).tolist() == [0.8, -0.6, 0.0, 0.0]
    assert nearer_sign(-quaternion, reference).tolist() == [0.8, -0.6, 0.0, 0.0]


def test_only_vectors_beyond_the_limit_are_shortened() -> None:
    vector = np.array([3.0, 0.0, 4.0])
    assert clamp_norm(vector, 5.0) is vector
    np.testing.assert_allclose(clamp_norm(vector, 0.5), [0.3, 0.0, 0.4], atol=1e-15)


def test_forward_hand_points_its_minus_z_ahead() -> None:
    expected = np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]])
    np.testing.assert_allclose(matrix_from_quaternion(FORWARD_HAND), expected, atol=1e-12)


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
    np.testing.assert_allclose(
        -matrix_from_quaternion(hand_quaternion(*rpy))[:, 2], ahead, atol=1e-12
    )


def test_rpy_turns_about_fixed_axes_x_first() -> None:
    def about(axis: int, angle: float) -> Array:
        return matrix_from_quaternion(quaternion_from_rotation_vector(angle * np.eye(3)[axis]))

    expected = about(2, 0.5) @ about(1, -0.4) @ about(0, 1.1)
    np.testing.assert_allclose(
        matrix_from_quaternion(quaternion_from_rpy(1.1, -0.4, 0.5)), expected, atol=1e-12
    )


@given(vectors, vectors)
def test_rotation_vector_inverts_rotate(start: Array, turn: Array) -> None:
    quaternion = quaternion_from_rotation_vector(start)
    angle = float(np.linalg.norm(turn))
    if angle > 3.0:
        turn = turn * (3.0 / angle)
    np.testing.assert_allclose(
        rotation_between(quaternion, rotate(quaternion, turn)), turn, atol=1e-9
    )


@given(vectors, vectors)
def test_rotation_vector_is_the_shortest_whatever_the_signs(a: Array, b: Array) -> None:
    start, end = quaternion_from_rotation_vector(a), quaternion_from_rotation_vector(b)
    turn = rotation_between(start, end)
    assert np.linalg.norm(turn) <= math.pi + 1e-9
    np.testing.assert_allclose(
        matrix_from_quaternion(rotate(start, turn)), matrix_from_quaternion(end), atol=1e-9
    )
    np.testing.assert_allclose(
        matrix_from_quaternion(rotate(start, rotation_between(start, -end))),
        matrix_from_quaternion(end),
        atol=1e-9,
    )


def test_rotate_stays_on_one_side_of_the_sphere_through_a_full_turn() -> None:
    quaternion = start = normalised(np.array([0.3, 0.2, -0.8, 0.1]))
    for _ in range(100):
        following = rotate(quaternion, np.array([0.0, 0.0, 2 * math.pi / 100]))
        assert following @ quaternion > 0.99
        quaternion = following
    np.testing.assert_allclose(quaternion, -start, atol=1e-9)
