"""Rotations against scipy's, with the corners near zero and near half a turn."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from services.wbc.rotations import (
    matrix_from_quaternion,
    matrix_from_rotation_vector,
    matrix_from_yaw,
    rotation_vector,
    wrap_angle,
    yaw_of,
)

from .support import Array

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
    vector = rotation_vector(matrix_from_rotation_vector(angle * axis))
    # Just below a half turn the skew part, sin(angle), has lost three digits.
    assert np.abs(vector - angle * axis).max() < 1e-12


@quick
@given(axes(), st.floats(-14.0, -5.0))
def test_small_rotations_keep_their_relative_precision(axis: Array, exponent: float) -> None:
    angle = 10.0**exponent
    vector = rotation_vector(matrix_from_rotation_vector(angle * axis))
    assert np.abs(vector - angle * axis).max() < 1e-9 * angle


@pytest.mark.parametrize("short", [0.0, 1e-12, 1e-9, 1e-6, 1e-5, 1e-4, 1e-3, 1.41e-3, 1.42e-3])
def test_angle_is_exact_near_half_a_turn(short: float) -> None:
    for axis in np.random.default_rng(1).normal(size=(50, 3)):
        expected = (np.pi - short) * axis / np.linalg.norm(axis)
        vector = rotation_vector(matrix_from_rotation_vector(expected))
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
        again = matrix_from_rotation_vector(rotation_vector(matrix))
        assert np.abs(again - matrix).max() < 1e-7


@pytest.mark.parametrize("axis", np.vstack((np.eye(3), -np.eye(3))))
def test_half_turns_about_the_axes(axis: Array) -> None:
    # diag(-1, -1, 1) and the like have no skew part at all; which of the two ends is free.
    matrix = 2.0 * np.outer(axis, axis) - np.eye(3)
    vector = rotation_vector(matrix)
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
    assert abs(yaw_of(tilted) - yaw) < 1e-13
    assert abs(yaw_of(matrix_from_yaw(yaw)) - yaw) < 1e-15
