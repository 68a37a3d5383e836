"""Every branch of the command guard."""

from typing import Any

import numpy as np
import pytest

from common.plant.config import GuardConfig
from common.plant.guard import Guard, Refusal, refuse_values
from common.robot.joints import JOINT_INDEX, POSITION_UPPER
from common.schemas import GuardMode
from tests.services.sim.support import MS, make_command

EPOCH = 1000 * MS
NOW = EPOCH + 10 * MS


def one_joint(name: str, value: float) -> Any:
    vector = np.zeros(27)
    vector[JOINT_INDEX[name]] = value
    return vector


def mode(guard: Guard) -> GuardMode:
    return guard.mode


@pytest.fixture
def guard() -> Guard:
    guard = Guard(GuardConfig(hold_after=0.1, damp_after=5.0))
    guard.reset(EPOCH)
    return guard


@pytest.fixture
def active(guard: Guard) -> Guard:
    assert guard.offer(make_command(NOW), NOW)
    return guard


def test_silent_until_the_first_command(guard: Guard) -> None:
    assert guard.tick(NOW + 3600_000 * MS, fallen=False) is GuardMode.SILENT
    assert guard.command is None
    assert guard.holds == 0


def test_a_sound_command_is_applied(guard: Guard) -> None:
    command = make_command(NOW - 5 * MS)
    assert guard.offer(command, NOW)
    assert mode(guard) is GuardMode.ACTIVE
    assert guard.command is command
    assert (guard.applied, guard.refused) == (1, 0)


def test_a_loop_delay_of_50_ms_at_100_hz_stays_active(guard: Guard) -> None:
    for tick in range(300):
        now = NOW + (60 + tick) * MS
        if tick % 10 == 0:
            assert guard.offer(make_command(now - 50 * MS), now)
        assert guard.tick(now, fallen=False) is GuardMode.ACTIVE
    assert guard.holds == 0


def test_silence_holds_then_damps(active: Guard) -> None:
    assert active.tick(NOW + 100 * MS, fallen=False) is GuardMode.ACTIVE
    assert active.tick(NOW + 100 * MS + 1, fallen=False) is GuardMode.HOLD
    assert active.tick(NOW + 200 * MS, fallen=False) is GuardMode.HOLD
    assert active.holds == 1
    assert active.tick(NOW + 5000 * MS, fallen=False) is GuardMode.HOLD
    assert active.tick(NOW + 5000 * MS + 1, fallen=False) is GuardMode.DAMP
    assert active.tick(NOW + 9000 * MS, fallen=False) is GuardMode.DAMP
    assert active.holds == 1


@pytest.mark.parametrize("silence_ms", [500, 6000])
def test_a_fresh_command_ends_hold_and_damp(active: Guard, silence_ms: int) -> None:
    now = NOW + silence_ms * MS
    assert active.tick(now, fallen=False) in (GuardMode.HOLD, GuardMode.DAMP)
    assert active.offer(make_command(now - 10 * MS), now)
    assert active.tick(now, fallen=False) is GuardMode.ACTIVE


def test_repeating_an_old_command_does_not_keep_the_robot_active(active: Guard) -> None:
    old = make_command(NOW)
    for ms in range(1, 301):
        active.offer(old, NOW + ms * MS)
        active.tick(NOW + ms * MS, fallen=False)
    assert mode(active) is GuardMode.HOLD
    assert active.last_refusal is Refusal.TOO_OLD
    assert (active.applied, active.refused) == (101, 200)


def test_estop_is_latched_until_reset(active: Guard) -> None:
    active.estop()
    assert active.tick(NOW, fallen=False) is GuardMode.ESTOP
    assert not active.offer(make_command(NOW), NOW)
    assert active.last_refusal is Refusal.ESTOPPED
    assert active.tick(NOW + 9000 * MS, fallen=True) is GuardMode.ESTOP
    active.reset(NOW)
    assert mode(active) is GuardMode.SILENT
    assert active.command is None
    assert active.offer(make_command(NOW + 1), NOW + 1)
    assert mode(active) is GuardMode.ACTIVE


def test_a_fallen_robot_stays_damped_until_reset(active: Guard) -> None:
    assert active.tick(NOW, fallen=True) is GuardMode.DAMP
    assert not active.offer(make_command(NOW), NOW)
    assert active.last_refusal is Refusal.FALLEN
    assert active.tick(NOW + MS, fallen=False) is GuardMode.DAMP
    assert not active.offer(make_command(NOW + MS), NOW + MS)
    active.reset(NOW)
    assert active.tick(NOW + MS, fallen=False) is GuardMode.SILENT


def test_falling_before_the_first_command_damps(guard: Guard) -> None:
    assert guard.tick(NOW, fallen=True) is GuardMode.DAMP


@pytest.mark.parametrize(
    ("stamp_ns", "refusal"),
    [
        (EPOCH, Refusal.BEFORE_RESET),
        (EPOCH - 1, Refusal.BEFORE_RESET),
        (NOW + 1, Refusal.FROM_FUTURE),
        (NOW - 5 * MS - 1, Refusal.OUT_OF_ORDER),
    ],
)
def test_stamps_that_are_refused(guard: Guard, stamp_ns: int, refusal: Refusal) -> None:
    first = make_command(NOW - 5 * MS)
    assert guard.offer(first, NOW)
    assert not guard.offer(make_command(stamp_ns), NOW)
    assert guard.last_refusal is refusal
    assert guard.command is first, "the last good command stands"
    assert (guard.applied, guard.refused) == (1, 1)


def test_too_old_even_as_the_first(guard: Guard) -> None:
    late = EPOCH + 200 * MS
    assert guard.offer(make_command(late - 100 * MS), late)
    guard.reset(EPOCH)
    assert not guard.offer(make_command(late - 100 * MS - 1), late)
    assert guard.last_refusal is Refusal.TOO_OLD


def test_the_same_stamp_again_is_no_disorder(active: Guard) -> None:
    assert active.offer(make_command(NOW), NOW + MS)


@pytest.mark.parametrize(
    ("changes", "refusal"),
    [
        ({"position": one_joint("l_elbow_fe", np.nan)}, Refusal.NOT_FINITE),
        ({"velocity": one_joint("l_elbow_fe", np.inf)}, Refusal.NOT_FINITE),
        ({"acceleration": one_joint("l_elbow_fe", -np.inf)}, Refusal.NOT_FINITE),
        ({"torque": one_joint("l_elbow_fe", np.nan)}, Refusal.NOT_FINITE),
        ({"stiffness": one_joint("l_elbow_fe", np.nan)}, Refusal.NOT_FINITE),
        ({"damping": one_joint("l_elbow_fe", np.nan)}, Refusal.NOT_FINITE),
        ({"gripper_closure": np.array([np.nan, 0.0])}, Refusal.NOT_FINITE),
        ({"stiffness": one_joint("r_ankle_fe", -0.1)}, Refusal.STIFFNESS),
        ({"stiffness": one_joint("r_ankle_fe", 1000.1)}, Refusal.STIFFNESS),
        ({"damping": one_joint("r_ankle_fe", -0.1)}, Refusal.DAMPING),
        ({"damping": one_joint("r_ankle_fe", 12.0)}, Refusal.DAMPING),
        ({"position": one_joint("l_elbow_fe", 0.0872665 + 0.21)}, Refusal.POSITION),
        ({"position": one_joint("l_elbow_fe", -2.0944 - 0.21)}, Refusal.POSITION),
        ({"velocity": one_joint("l_hip_aa", -5 * 5.1 - 0.1)}, Refusal.VELOCITY),
        ({"acceleration": one_joint("neck_pitch", 2001.0)}, Refusal.ACCELERATION),
        ({"torque": one_joint("l_wrist_ps", -24.1)}, Refusal.TORQUE),
        ({"gripper_closure": np.array([0.0, 1.1])}, Refusal.GRIPPER),
        ({"gripper_closure": np.array([-0.1, 0.0])}, Refusal.GRIPPER),
    ],
)
def test_values_that_are_refused(active: Guard, changes: dict[str, Any], refusal: Refusal) -> None:
    standing = active.command
    assert not active.offer(make_command(NOW + MS, **changes), NOW + MS)
    assert active.last_refusal is refusal
    assert active.command is standing
    assert mode(active) is GuardMode.ACTIVE


@pytest.mark.parametrize(
    "changes",
    [
        {"position": one_joint("l_elbow_fe", 0.0872665 + 0.19)},
        {"torque": one_joint("l_hip_fe", 500.0)},
        {"stiffness": np.full(27, 1000.0), "damping": one_joint("l_hip_fe", 60.0)},
        {"velocity": one_joint("l_hip_aa", 25.0)},
        {"gripper_closure": np.array([1.0, 1.04])},
        {"position": POSITION_UPPER},
    ],
)
def test_values_that_are_merely_bold_pass(changes: dict[str, Any]) -> None:
    assert refuse_values(make_command(NOW, **changes)) is None
