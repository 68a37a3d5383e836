"""The box of the hands, the same for both but mirrored."""

import numpy as np
import pytest

from common.robot.frames import NOMINAL_HAND_IN_BODY
from common.robot.workspace import clamp_to_workspace

MIRROR = np.array([1.0, -1.0, 1.0])


def test_points_outside_are_moved_to_the_nearest_point_inside() -> None:
    far = np.array([9.0, 9.0, 9.0])
    assert clamp_to_workspace("left", far).tolist() == [0.56, 0.45, 0.40]
    assert clamp_to_workspace("left", -far).tolist() == [0.15, -0.10, -0.15]
    assert clamp_to_workspace("right", far).tolist() == [0.56, 0.10, 0.40]
    assert clamp_to_workspace("right", -far).tolist() == [0.15, -0.45, -0.15]


@pytest.mark.parametrize("seed", range(3))
def test_the_right_box_mirrors_the_left(seed: int) -> None:
    for point in np.random.default_rng(seed).uniform(-1.0, 1.0, (50, 3)):
        left, right = clamp_to_workspace("left", point), clamp_to_workspace("right", point * MIRROR)
        np.testing.assert_array_equal(left * MIRROR, right)
        np.testing.assert_array_equal(clamp_to_workspace("left", left), left)


def test_the_nominal_hands_are_inside() -> None:
    for side, position in NOMINAL_HAND_IN_BODY.items():
        assert clamp_to_workspace(side, np.array(position)).tolist() == list(position)
