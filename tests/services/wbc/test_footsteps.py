"""Where the six gaits put the feet."""

import numpy as np
import pytest

from common.robot.rotations import matrix_from_yaw, wrap_angle
from common.schemas import Gait
from services.wbc.config import GaitConfig
from services.wbc.footsteps import (
    Footprint,
    Side,
    Stance,
    gait_displacement,
    plan_footsteps,
    stance_between,
)

from .support import GAITS, Array

CONFIG = GaitConfig()
WIDTH = CONFIG.stance_width
STANCE = Stance(np.array([0.7, -1.1]), 2.9)
TURN = np.deg2rad(18.0)


def _in_frame(stance: Stance, position: Array) -> Array:
    local: Array = matrix_from_yaw(stance.yaw)[:2, :2].T @ (position - stance.position)
    return local


def _walk(stance: Stance, gait: Gait) -> Stance:
    first, second = plan_footsteps(gait, stance, CONFIG)
    left, right = (first, second) if first.side == 0 else (second, first)
    return stance_between(left, right)


@pytest.mark.parametrize(
    ("gait", "forward", "left", "turn"),
    [
        (Gait.FORWARD, 0.2, 0.0, 0.0),
        (Gait.BACKWARD, -0.2, 0.0, 0.0),
        (Gait.SIDE_LEFT, 0.0, 0.1, 0.0),
        (Gait.SIDE_RIGHT, 0.0, -0.1, 0.0),
        (Gait.TURN_LEFT, 0.0, 0.0, TURN),
        (Gait.TURN_RIGHT, 0.0, 0.0, -TURN),
    ],
)
def test_displacement_in_the_stance_frame(
    gait: Gait, forward: float, left: float, turn: float
) -> None:
    after = _walk(STANCE, gait)
    assert _in_frame(STANCE, after.position) == pytest.approx([forward, left], abs=1e-12)
    assert wrap_angle(after.yaw - STANCE.yaw) == pytest.approx(turn, abs=1e-12)
    for foot in plan_footsteps(gait, STANCE, CONFIG):
        outward = 0.14 if foot.side == 0 else -0.14
        assert _in_frame(after, foot.position) == pytest.approx([0.0, outward], abs=1e-12)
        assert foot.yaw == pytest.approx(after.yaw)


@pytest.mark.parametrize(
    ("gait", "first"),
    [
        (Gait.FORWARD, 0),
        (Gait.BACKWARD, 0),
        (Gait.SIDE_LEFT, 0),
        (Gait.SIDE_RIGHT, 1),
        (Gait.TURN_LEFT, 0),
        (Gait.TURN_RIGHT, 1),
    ],
)
def test_which_foot_goes_first(gait: Gait, first: int) -> None:
    assert [foot.side for foot in plan_footsteps(gait, STANCE, CONFIG)] == [first, 1 - first]


@pytest.mark.parametrize("gait", [Gait.TURN_LEFT, Gait.TURN_RIGHT])
def test_twenty_turns_are_one_revolution_on_the_spot(gait: Gait) -> None:
    stance, turned = STANCE, 0.0
    for _ in range(20):
        after = _walk(stance, gait)
        turned += wrap_angle(after.yaw - stance.yaw)
        stance = after
    assert abs(turned) == pytest.approx(2.0 * np.pi, abs=1e-9)
    assert np.abs(stance.position - STANCE.position).max() < 1e-12
    assert abs(wrap_angle(stance.yaw - STANCE.yaw)) < 1e-9


@pytest.mark.parametrize("gait", GAITS)
def test_feet_never_cross(gait: Gait) -> None:
    """Over both steps the soles' boxes (half size 0.125 x 0.075 m) stay clear of each other."""
    feet: dict[Side, Footprint] = {0: STANCE.foot(0, WIDTH), 1: STANCE.foot(1, WIDTH)}
    for step in plan_footsteps(gait, STANCE, CONFIG):
        start, standing = feet[step.side], feet[1 if step.side == 0 else 0]
        for share in np.linspace(0.0, 1.0, 21):
            position = start.position + share * (step.position - start.position)
            yaw = start.yaw + share * wrap_angle(step.yaw - start.yaw)
            corners = matrix_from_yaw(yaw)[:2, :2] @ (
                np.array([[0.125, 0.125, -0.125, -0.125], [0.075, -0.075, 0.075, -0.075]])
            )
            frame = Stance(standing.position, standing.yaw)
            lateral = [_in_frame(frame, position + corner)[1] for corner in corners.T]
            outward = min(lateral) if step.side == 0 else -max(lateral)
            assert outward > 0.075 + 0.02
        feet[step.side] = step


def test_none_is_no_gait() -> None:
    with pytest.raises(ValueError, match="NONE has no footsteps"):
        plan_footsteps(Gait.NONE, STANCE, CONFIG)
    assert gait_displacement(Gait.NONE, CONFIG) == (0.0, 0.0, 0.0)


def test_stance_between_feet_that_straddle_half_a_turn() -> None:
    stance = Stance(np.zeros(2), np.pi - 0.01)
    left = Footprint(0, stance.foot(0, WIDTH).position, wrap_angle(np.pi + 0.09))
    right = Footprint(1, stance.foot(1, WIDTH).position, np.pi - 0.03)
    middle = stance_between(left, right)
    assert abs(wrap_angle(middle.yaw - (np.pi + 0.03))) < 1e-12
    assert np.abs(middle.position).max() < 1e-12


def test_feet_of_a_stance() -> None:
    stance = Stance(np.array([1.0, 2.0]), np.pi / 2)
    assert stance.foot(0, 0.3).position == pytest.approx([0.85, 2.0])
    assert stance.foot(1, 0.3).position == pytest.approx([1.15, 2.0])
