"""A robot that is taken over follows only commands near its posture, and gradually."""

from typing import Any

import numpy as np
import pytest

from common.plant.guard import Guard, Refusal
from common.plant.reentry import DURATION_NS, FARTHEST, is_far
from common.robot.joints import JOINT_INDEX, NOMINAL_POSITION
from common.schemas import GuardMode
from tests.services.sim.support import MS, make_command

from .support import NOW, mode, offer, one_joint

ELBOW = JOINT_INDEX["l_elbow_fe"]


def away(distance: float) -> Any:
    """Nominal positions with one joint elsewhere [rad]."""
    position = NOMINAL_POSITION.copy()
    position[ELBOW] += distance
    return position


@pytest.mark.parametrize("silence_ms", [0, 500, 6000])
def test_a_robot_taken_over_follows_no_command_that_is_far_off(
    guard: Guard, silence_ms: int
) -> None:
    now = NOW
    if silence_ms:
        assert offer(guard, make_command(NOW), NOW)
        now += silence_ms * MS
        guard.tick(now, fallen=False)
    for distance in (-0.4, 0.4, 0.31):
        assert not offer(guard, make_command(now), now, measured=away(distance))
        assert guard.last_refusal is Refusal.FAR
    assert mode(guard) is not GuardMode.ACTIVE
    assert offer(guard, make_command(now), now, measured=away(0.29))
    for soon in range(now + 50 * MS, now + DURATION_NS + 1, 50 * MS):
        assert guard.tick(soon, fallen=False) is GuardMode.ACTIVE
        assert not offer(guard, make_command(soon), soon, measured=away(0.31)), "still taking over"
        assert offer(guard, make_command(soon), soon)


def test_once_taken_over_commands_may_be_anywhere(guard: Guard) -> None:
    for ms in range(0, 502, 2):
        assert offer(guard, make_command(NOW + ms * MS), NOW + ms * MS)
        guard.tick(NOW + ms * MS, fallen=False)
    now = NOW + DURATION_NS + 1
    assert offer(guard, make_command(now), now, measured=away(0.8))
    assert guard.eased(NOMINAL_POSITION, now, away(0.8)) is NOMINAL_POSITION


def test_a_joint_that_has_moved_on_since_the_measurement_is_not_far(guard: Guard) -> None:
    now = NOW + 90 * MS
    command = make_command(NOW, velocity=one_joint("l_elbow_fe", 5.0))
    assert not offer(guard, command, now, measured=away(0.45 - 0.31))
    assert not offer(guard, command, now, measured=away(0.45 + 0.31))
    assert offer(guard, command, now, measured=away(0.45))


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_set_points_start_where_the_joints_are_and_leave_at_a_bounded_rate(
    guard: Guard, sign: float
) -> None:
    measured = away(-0.25 * sign)
    reached = []
    for ms in range(0, 510, 10):
        now = NOW + ms * MS
        assert offer(guard, make_command(now), now, measured=measured)
        applied = guard.eased(NOMINAL_POSITION, now, measured)
        assert (np.delete(applied, ELBOW) == np.delete(NOMINAL_POSITION, ELBOW)).all()
        reached.append(sign * (applied[ELBOW] - measured[ELBOW]))
    assert reached[0] == pytest.approx(0.02)
    assert np.diff(reached[:24]) == pytest.approx(0.01), "1 rad/s"
    assert np.array(reached[23:]) == pytest.approx(0.25)


def test_the_farthest_is_not_too_far() -> None:
    origin = make_command(NOW, position=np.zeros(27))
    assert not is_far(origin, NOW, one_joint("l_elbow_fe", FARTHEST))
    assert is_far(origin, NOW, one_joint("l_elbow_fe", np.nextafter(FARTHEST, 1.0)))


def test_a_command_that_expects_nan_is_far(guard: Guard) -> None:
    assert not offer(guard, make_command(NOW), NOW, measured=away(np.nan))
    assert guard.last_refusal is Refusal.FAR
