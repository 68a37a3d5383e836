"""Short versions of the walking checks."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from common.schemas import Gait
from verification.walking import checks
from verification.walking.checks import NOISY, STANDING, STEPPING, Check
from verification.walking.measures import push, silence, walk
from verification.walking.meetings import Meeting, meetings, random_meetings
from verification.walking.stack import NOISE, Scenario, Stack, commanded_stance

NOISY_STEP = replace(NOISY, gaits=(Gait.FORWARD,))


def assert_kept(check: Check) -> None:
    numbers = check.measure()
    assert check.keeps(numbers), check.describe(numbers)


@pytest.mark.parametrize("gait", checks.SIX)
def test_each_gait_twice_with_delay_and_noise_ends_where_commanded(gait: Gait) -> None:
    assert_kept(checks.walk_check("", "", replace(NOISY, gaits=(gait,) * 2, seed=int(gait))))


def test_each_pair_of_gaits_in_one_rated_walk() -> None:
    assert_kept(checks.walk_check("", "", replace(NOISY, gaits=checks.SIX, torque_mode="rated")))


def test_random_gaits_with_moving_hands() -> None:
    assert_kept(checks.random_check(4))


def test_loop_delay_of_30_ms_walks() -> None:
    numbers = walk(Scenario(gaits=(Gait.FORWARD, Gait.TURN_RIGHT), delay=0.03))
    assert not numbers["fell"]
    assert numbers["completed"] == 2


@pytest.mark.parametrize("degrees", [0, 135, 270])
def test_pushes_of_100_newtons_standing(degrees: int) -> None:
    angle = np.radians(degrees)
    assert push(STANDING, 100.0 * np.array([np.cos(angle), np.sin(angle), 0.0]), 2.0)


@pytest.mark.parametrize(("degrees", "at"), [(90, 2.3), (180, 2.8)])
def test_pushes_of_60_newtons_walking(degrees: int, at: float) -> None:
    angle = np.radians(degrees)
    assert push(STEPPING, 60.0 * np.array([np.cos(angle), np.sin(angle), 0.0]), at)


def test_a_push_beyond_any_balance_falls() -> None:
    assert not push(STANDING, np.array([600.0, 0.0, 0.0]), 2.0)


def test_silence_of_90_ms_while_walking_goes_unnoticed() -> None:
    numbers = silence(STEPPING, 2.3, 0.09)
    assert not numbers["held"]
    assert not numbers["fell"]


@pytest.mark.parametrize(("length", "restart"), [(1.0, False), (0.5, True)])
def test_silence_or_restart_while_standing_is_held_and_left_without_a_jump(
    length: float, restart: bool
) -> None:
    numbers = silence(STANDING, 2.0, length, restart)
    assert numbers["held"]
    assert not numbers["fell"]
    assert float(numbers["joint_step_rad"]) < 0.05


@pytest.mark.parametrize(
    ("seed", "at"), [(0, 2.25), (0, 3.0), (0, 3.3), (1, 2.7), (1, 2.95), (1, 3.25)]
)
def test_silence_of_3_s_on_one_leg_with_delay_and_noise_is_survived(seed: int, at: float) -> None:
    numbers = silence(replace(NOISY_STEP, seed=seed), at, 3.0)
    assert numbers["held"]
    assert not numbers["fell"]


def test_controller_restarted_in_mid_gait_puts_the_foot_down() -> None:
    numbers = checks.walking_silence("", 0.5, (NOISY_STEP,), (0.24, 0.51), restart=True).measure()
    assert (numbers["runs"], numbers["held"], numbers["falls"]) == (2, 2.0, 0)


@pytest.mark.parametrize("axis", [1, 2])
def test_hands_follow_a_sine_standing(axis: int) -> None:
    assert_kept(checks.tracking_check(axis, (), 0.010))


def test_hands_follow_a_sine_walking() -> None:
    assert_kept(checks.tracking_check(2, (Gait.FORWARD,), 0.020))


def test_static_reach() -> None:
    assert_kept(checks.reach_check(checks.REACH_TARGETS[0]))


def test_same_seed_same_bytes() -> None:
    assert_kept(checks.determinism_check(1))


def test_a_number_beyond_its_limit_breaks_the_promise() -> None:
    check = Check("", "", dict, {"error_m": 0.01}, {"completed": 2})
    assert check.keeps({"error_m": 0.01, "completed": 2})
    assert not check.keeps({"error_m": 0.011, "completed": 2})
    assert not check.keeps({"error_m": 0.01, "completed": 1})
    assert check.describe({"error_m": 0.01, "note": ""}) == "error_m 0.01 (≤ 0.01)"


def test_exact_solver_walks_to_the_same_place() -> None:
    gaits = (Gait.FORWARD,)
    ends = []
    solvers: tuple[Literal["osqp", "daqp"], ...] = ("osqp", "daqp")
    for solver in solvers:
        stack = Stack(Scenario(gaits=gaits, solver=solver))
        start = stack.stance()
        stack.run_script()
        goal = commanded_stance(start, gaits, stack.wbc_service.config)
        ends.append(stack.stance().position)
        assert np.linalg.norm(ends[-1] - goal.position) < 0.005
    assert np.linalg.norm(ends[0] - ends[1]) < 0.002


FALLER = Meeting("middle", np.array((0.506, -0.025, 0.051)), np.array((0.506, -0.025, 0.051)))
"""Here the upper arms once pressed the chest with 115 N each."""


@pytest.mark.parametrize("index", [8, 14, 16, 21, 28, 30, 41, 58, 87])
def test_hands_that_meet_each_other_or_the_body_topple_nothing(index: int) -> None:
    """Of each kind some that toppled the robot while nothing kept its arms apart.

    The first did while its legs made way for an arm.
    """
    meeting = random_meetings(300, 2026)[index]
    numbers = meetings([meeting], Scenario(delay=0.02, noise=NOISE))
    assert not numbers["falls"], meeting
    assert float(numbers["force_n"]) < 100.0


def test_arms_do_not_press_the_chest() -> None:
    assert meetings([FALLER], Scenario(delay=0.02, noise=NOISE))["force_n"] == 0.0
