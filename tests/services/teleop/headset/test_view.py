"""Hands in pictures: where a hand is seen, and where a drag puts it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.robot.cameras import camera_in_body
from common.robot.workspace import clamp_to_workspace
from services.teleop.headset.view import DragStart, in_picture, seen_from

START = np.array([0.35, 0.25, 0.1])
parts = st.floats(-3.0, 3.0)


def test_a_point_is_seen_where_a_pinhole_camera_sees_it() -> None:
    # The picture sees 60° up and down, so its upper edge is half a height above the centre.
    camera = camera_in_body("left", 0.3)
    edge = camera.apply(np.array([0.0, -np.tan(np.pi / 3) * 0.4, 0.4]))
    assert in_picture(seen_from("left", 0.3, edge)) == pytest.approx((0.0, -0.5))
    assert in_picture(np.array([0.1, 0.1, -0.2])) is None


@settings(deadline=None)
@given(across=st.floats(-0.05, 0.05), down=st.floats(-0.05, 0.05), neck=st.floats(-0.3, 0.6))
def test_a_hand_goes_with_the_pointer(across: float, down: float, neck: float) -> None:
    drag = DragStart("left", START, neck, np.zeros(3))
    before = in_picture(seen_from("left", neck, START))
    goal = drag.goal(np.array([across, down, 0.0]))
    after = in_picture(seen_from("left", neck, goal))
    assert before is not None
    assert after is not None
    assert np.subtract(after, before).tolist() == pytest.approx([across, down], abs=1e-9)


@settings(deadline=None)
@given(st.tuples(parts, parts, parts))
def test_a_hand_stays_in_the_workspace(way: tuple[float, float, float]) -> None:
    goal = DragStart("left", START, 0.2, np.zeros(3)).goal(np.array(way))
    np.testing.assert_array_equal(goal, clamp_to_workspace("left", goal))


def test_ahead_is_away_from_the_camera() -> None:
    drag = DragStart("left", START, 0.0, np.zeros(3))
    np.testing.assert_allclose(drag.goal(np.array([0.0, 0.0, 0.05])) - START, [0.05, 0, 0])
