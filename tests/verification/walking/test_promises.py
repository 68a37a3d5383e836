"""Small versions of the walking study: the same checks, fewer gaits."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from common.schemas import Gait
from verification.walking import checks
from verification.walking.measures import push, silence, walk
from verification.walking.stack import NOISE, Scenario, Stack, commanded_stance

NOISY = Scenario(delay=0.01, noise=NOISE)


@pytest.mark.parametrize("gait", checks.SIX)
def test_each_gait_twice_with_delay_and_noise_ends_where_commanded(gait: Gait) -> None:
    outcome = checks.gait_check(gait, 2, NOISY)
    assert outcome.passed, outcome.text


def test_each_pair_of_gaits_in_one_rated_walk() -> None:
    result = walk(replace(NOISY, gaits=checks.SIX, mode="rated"))
    assert not result.fell
    assert result.completed == 6
    assert result.within_tolerance, result


def test_random_gaits_with_moving_hands() -> None:
    outcome = checks.random_check(4, 7)
    assert outcome.passed, outcome.text


def test_loop_delay_of_30_ms_walks() -> None:
    result = walk(Scenario(gaits=(Gait.FORWARD, Gait.TURN_RIGHT), delay=0.03))
    assert not result.fell
    assert result.completed == 2


@pytest.mark.parametrize("degrees", [0, 135, 270])
def test_pushes_of_100_newtons_standing(degrees: int) -> None:
    angle = np.radians(degrees)
    assert push(Scenario(), 100.0 * np.array([np.cos(angle), np.sin(angle), 0.0]), 2.0)


@pytest.mark.parametrize(("degrees", "at"), [(90, 2.3), (180, 2.8)])
def test_pushes_of_60_newtons_walking(degrees: int, at: float) -> None:
    angle = np.radians(degrees)
    force = 60.0 * np.array([np.cos(angle), np.sin(angle), 0.0])
    assert push(Scenario(gaits=(Gait.FORWARD,)), force, at)


def test_a_push_beyond_any_balance_falls() -> None:
    assert not push(Scenario(), np.array([600.0, 0.0, 0.0]), 2.0)


def test_silence_of_90_ms_while_walking_goes_unnoticed() -> None:
    result = silence(Scenario(gaits=(Gait.FORWARD,)), 2.3, 0.09)
    assert not result.held
    assert not result.fell


def test_silence_of_1_s_standing_is_held_and_left_without_a_jump() -> None:
    result = silence(Scenario(), 2.0, 1.0)
    assert result.held
    assert not result.fell
    assert result.joint_step < 0.05


def test_restarted_controller_takes_over_without_a_jump() -> None:
    result = silence(Scenario(), 2.0, 0.5, restart=True)
    assert result.held
    assert not result.fell
    assert result.joint_step < 0.05


@pytest.mark.parametrize("at", [2.0, 2.9])
def test_controller_restarted_in_mid_gait_puts_the_foot_down(at: float) -> None:
    outcome = checks.midway_check(0.5, True, (at,))
    assert outcome.passed, outcome.text


@pytest.mark.parametrize("axis", [1, 2])
def test_hands_follow_a_sine_standing(axis: int) -> None:
    outcome = checks.tracking_check(axis, (), 0.010)
    assert outcome.passed, outcome.text


def test_hands_follow_a_sine_walking() -> None:
    outcome = checks.tracking_check(2, (Gait.FORWARD,), 0.020)
    assert outcome.passed, outcome.text


def test_static_reach() -> None:
    outcome = checks.reach_check(checks.REACH_TARGETS[0])
    assert outcome.passed, outcome.text


def test_same_seed_same_bytes() -> None:
    outcome = checks.determinism_check(1)
    assert outcome.passed, outcome.text


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
