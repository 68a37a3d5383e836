"""The swing foot's reference: start, apex, landing, and that rates are rates."""

import numpy as np
import pytest

from common.robot.rotations import (
    matrix_from_rotation_vector,
    matrix_from_yaw,
    rotation_vector_from_matrix,
)
from services.wbc.swing import SwingTrajectory, minimum_jerk

from .support import Array

DURATION = 0.65
START, START_ROTATION = np.array([0.1, 0.14, 0.02]), matrix_from_yaw(0.2)
END = np.array([0.5, 0.1, 0.05])
END_ROTATION = matrix_from_yaw(0.2 + 0.314) @ matrix_from_rotation_vector(np.array([0, 0.1, 0]))
SWING = SwingTrajectory(
    start=START,
    start_rotation=START_ROTATION,
    end=END,
    end_rotation=END_ROTATION,
    height=0.06,
    duration=DURATION,
)
TIMES = np.linspace(0.011, DURATION - 0.011, 40)


def test_starts_and_ends_at_rest() -> None:
    for time, position, rotation in (
        (0.0, START, START_ROTATION),
        (-1.0, START, START_ROTATION),
        (DURATION, END, END_ROTATION),
        (DURATION + 1.0, END, END_ROTATION),
    ):
        reference = SWING.at(time)
        assert np.abs(reference.position - position).max() < 1e-12
        assert np.abs(reference.rotation - rotation).max() < 1e-12
        assert not reference.velocity.any()
        assert not reference.acceleration.any()


def test_apex_is_above_the_higher_end() -> None:
    heights = [SWING.at(time).position[2] for time in np.linspace(0.0, DURATION, 400)]
    assert SWING.at(0.5 * DURATION).position[2] == pytest.approx(0.05 + 0.06, abs=1e-12)
    assert max(heights) == pytest.approx(0.11, abs=1e-5)
    assert min(heights) == pytest.approx(0.02, abs=1e-12)
    # Up, then down: the foot never dips on the way.
    top = int(np.argmax(heights))
    assert (np.diff(heights[: top + 1]) >= 0.0).all()
    assert (np.diff(heights[top:]) <= 0.0).all()


def test_horizontal_way_is_straight_and_halfway_in_the_middle() -> None:
    middle = SWING.at(0.5 * DURATION)
    assert middle.position[:2] == pytest.approx([0.3, 0.12], abs=1e-12)
    # The quintic's peak rate is 15/8 of the mean.
    assert middle.velocity[0] == pytest.approx(1.875 * 0.4 / DURATION)


def test_rotation_turns_once_from_start_to_end() -> None:
    """A full-time minimum-jerk share of one turn, not twice the turn in half the time each."""
    turn = rotation_vector_from_matrix(END_ROTATION @ START_ROTATION.T)
    for time in TIMES:
        share = minimum_jerk(time / DURATION, DURATION)[0]
        turned = rotation_vector_from_matrix(SWING.at(time).rotation @ START_ROTATION.T)
        assert np.abs(turned - share * turn).max() < 1e-12


def _rotation_rate(time: float, h: float) -> Array:
    after, before = SWING.at(time + h).rotation, SWING.at(time - h).rotation
    return rotation_vector_from_matrix(after @ before.T) / (2.0 * h)


def test_velocity_is_the_rate_of_the_pose() -> None:
    h = 1e-6
    for time in TIMES:
        velocity = SWING.at(time).velocity
        linear = (SWING.at(time + h).position - SWING.at(time - h).position) / (2.0 * h)
        assert np.abs(velocity[:3] - linear).max() < 1e-7
        assert np.abs(velocity[3:] - _rotation_rate(time, h)).max() < 1e-7


def test_acceleration_is_the_rate_of_the_velocity() -> None:
    h = 1e-6
    for time in TIMES:
        change = (SWING.at(time + h).velocity - SWING.at(time - h).velocity) / (2.0 * h)
        assert np.abs(SWING.at(time).acceleration - change).max() < 1e-4


@pytest.mark.parametrize("duration", [0.3, 1.0, 2.0])
def test_minimum_jerk_scales_with_its_duration(duration: float) -> None:
    h = 1e-6 * duration
    for time in np.linspace(0.05, 0.95, 19) * duration:
        _, rate, acceleration = minimum_jerk(time / duration, duration)
        before, after = (minimum_jerk((time + d) / duration, duration) for d in (-h, h))
        assert rate == pytest.approx((after[0] - before[0]) / (2 * h), abs=1e-7)
        assert acceleration == pytest.approx((after[1] - before[1]) / (2 * h), abs=1e-6)
    assert minimum_jerk(0.5, duration)[0] == 0.5
