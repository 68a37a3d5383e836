"""Holding without commands: a foot in mid-swing is put down, anything else stays."""

from typing import Any

import numpy as np
import pytest

from common.plant.fallback import (
    HOLD_DAMPING,
    HOLD_STIFFNESS,
    LOWERING_NS,
    Hold,
    hold_target,
    plan_hold,
)
from common.plant.limits import EFFECTIVE_INERTIA
from common.robot.joints import JOINT_INDEX, LEFT_LEG, NOMINAL_POSITION, RIGHT_LEG
from common.robot.kinematics import foot_in_body
from common.robot.pose import Pose

NOW = 5_000_000_000
END = NOW + LOWERING_NS
TORQUE = np.linspace(-20.0, 20.0, 27)
SPEED = np.linspace(-0.5, 0.5, 27)
SIDES = pytest.mark.parametrize(
    ("side", "other", "leg"), [("left", "right", LEFT_LEG), ("right", "left", RIGHT_LEG)]
)


def bent(side: str, **turns: float) -> Any:
    """The nominal posture with some joints of one leg turned [rad]."""
    position = NOMINAL_POSITION.copy()
    for name, turn in turns.items():
        position[JOINT_INDEX[f"{side[0]}_{name}"]] += turn
    return position


def in_mid_swing(side: str) -> Any:
    """The posture with a foot up to a fifth of a step ahead, tilted and turned."""
    sign = 1.0 if side == "left" else -1.0
    return bent(
        side, hip_ie=0.05 * sign, hip_fe=-0.25, knee_fe_jp=0.2, knee_fe_jd=0.2, ankle_ie=0.04 * sign
    )


def hold(position: Any, *forces: float) -> Hold:
    return plan_hold(NOW, position, SPEED, TORQUE, np.array(forces))


def relative(side: str, other: str, position: Any) -> Pose:
    """The pose of a sole in the frame of the other."""
    return foot_in_body(other, position).local_pose(foot_in_body(side, position))


def assert_held(found: Hold, position: Any) -> None:
    """It stays at the posture, and nothing is left to follow."""
    assert found.end_ns == NOW
    for now in (NOW, NOW + LOWERING_NS // 2, END):
        expected = hold_target(now, position, TORQUE)
        np.testing.assert_allclose(found.target(now).law, expected.law, atol=1e-9)


@SIDES
def test_a_raised_foot_is_put_down_flat_where_it_is(side: str, other: str, leg: slice) -> None:
    position = in_mid_swing(side)
    before = relative(side, other, position)
    assert before.position[2] > 0.05
    found = hold(position, *((0.0, 350.0) if side == "left" else (350.0, 0.0)))
    assert found.end_ns == END
    lowered = found.begin + found.change
    after = relative(side, other, lowered)
    np.testing.assert_allclose(after.position, [*before.position[:2], 0.0], atol=1e-5)
    assert np.abs(after.quaternion[1:3]).max() < 1e-6
    assert after.yaw == pytest.approx(before.yaw, abs=1e-5)
    np.testing.assert_array_equal(np.delete(lowered, leg), np.delete(position, leg))


@SIDES
def test_the_foot_begins_as_it_moves_and_ends_at_rest(side: str, other: str, leg: slice) -> None:
    position = in_mid_swing(side)
    found = hold(position, *((0.0, 350.0) if side == "left" else (350.0, 0.0)))
    speed = np.zeros(27)
    speed[leg] = SPEED[leg]
    first = hold_target(NOW, position, TORQUE, speed)
    np.testing.assert_allclose(found.target(NOW).law, first.law, atol=1e-9)
    for now in (END, END + 10**9):
        last = hold_target(now, position + found.change, TORQUE)
        np.testing.assert_allclose(found.target(now).law, last.law, atol=1e-9)
    # Half-way: half of the change, and an eighth of the distance at the first speed.
    half = 0.5 * found.change + 0.3 * speed / 8.0
    rate = 1.5 * found.change / 0.3 - speed / 4.0
    middle = hold_target(NOW + LOWERING_NS // 2, position + half, TORQUE, rate)
    np.testing.assert_allclose(found.target(NOW + LOWERING_NS // 2).law, middle.law, atol=1e-9)


def test_a_foot_that_lands_early_stops_where_it_is_and_nothing_else_does() -> None:
    position = in_mid_swing("left")
    planned = hold(position, 0.0, 350.0)
    now = NOW + LOWERING_NS // 2
    measured = position + 0.01
    assert planned.landed(now, measured, np.array([29.0, 330.0])) is planned
    landed = planned.landed(now, measured, np.array([30.0, 330.0]))
    expected = position.copy()
    moved = np.flatnonzero(planned.change)
    assert set(moved) <= set(range(LEFT_LEG.start, LEFT_LEG.stop))
    expected[moved] += 0.01
    for later in (now, END):
        law = hold_target(later, expected, TORQUE).law
        np.testing.assert_allclose(landed.target(later).law, law, atol=1e-9)
    assert landed.end_ns == now
    assert planned.landed(END, measured, np.array([180.0, 180.0])) is planned


@pytest.mark.parametrize("forces", [(180.0, 170.0), (31.0, 320.0), (0.0, 0.0), (0.0, 29.0)])
def test_without_exactly_one_carrying_foot_the_posture_is_held(forces: tuple[float, float]) -> None:
    position = in_mid_swing("left")
    assert_held(hold(position, *forces), position)


def test_a_foot_far_above_the_other_is_no_step_and_stays() -> None:
    position = bent("left", hip_fe=-0.6, knee_fe_jp=0.3, knee_fe_jd=0.3)
    assert relative("left", "right", position).position[2] > 0.15
    assert_held(hold(position, 0.0, 350.0), position)


def test_a_foot_that_would_not_reach_the_ground_stays() -> None:
    """Both legs are straight, and one is spread to the side."""
    position = NOMINAL_POSITION.copy()
    for leg in (LEFT_LEG, RIGHT_LEG):
        position[leg] = 0.0
    position[JOINT_INDEX["l_hip_aa"]] = 0.6
    assert 0.05 < relative("left", "right", position).position[2] < 0.15
    assert_held(hold(position, 0.0, 350.0), position)


def test_gains_suit_one_leg_and_the_servo() -> None:
    step = 1e-3
    assert (HOLD_STIFFNESS * step**2 / EFFECTIVE_INERTIA).max() < 0.2
    assert (HOLD_DAMPING * step / EFFECTIVE_INERTIA).max() < 0.6
    hip, knee, ankle = (
        HOLD_STIFFNESS[JOINT_INDEX[name]] for name in ("l_hip_fe", "l_knee_fe_jd", "l_ankle_fe")
    )
    toppling = 36.5 * 9.81 * 0.7
    assert 1.0 / (1.0 / hip + 0.5 / knee + 1.0 / ankle) > 3.0 * toppling
