"""The DCM plan obeys the pendulum it was planned for."""

from typing import NamedTuple

import numpy as np
import pytest

from services.wbc.dcm import (
    GRID,
    TAIL,
    DcmPlan,
    DcmTiming,
    first_order,
    natural_frequency,
    plan_dcm,
    smoothstep,
)

from .support import Array

OMEGA = natural_frequency(0.70)
TIMINGS = {
    "fast": DcmTiming(0.5, 0.5, 0.2, 0.3, 0.2),
    "normal": DcmTiming(0.8, 0.65, 0.35, 0.5, 0.4),
    "public": DcmTiming(1.5, 1.0, 1.0, 1.0, 0.6),
}
START = np.array([1.3, -0.4])
STANCES = [START + np.array([0.0, -0.14]), START + np.array([0.2, 0.14])]
END = START + np.array([0.2, 0.0])


class Case(NamedTuple):
    plan: DcmPlan
    timing: DcmTiming

    @property
    def swings(self) -> list[tuple[float, float]]:
        t = self.timing
        first = t.initial_transfer
        second = first + t.single_support + t.double_support
        return [(first, first + t.single_support), (second, second + t.single_support)]


@pytest.fixture(params=TIMINGS)
def case(request: pytest.FixtureRequest) -> Case:
    timing = TIMINGS[request.param]
    return Case(plan_dcm(START, START, STANCES, END, timing, OMEGA), timing)


def _slope(track: Array) -> Array:
    return (track[2:] - track[:-2]) / (2.0 * GRID)


def test_natural_frequency_of_the_public_height() -> None:
    assert natural_frequency(0.65) == pytest.approx(3.8849, abs=1e-4)


def test_recursion_is_scipys_filter() -> None:
    from scipy.signal import lfilter

    rng = np.random.default_rng(3)
    start, decay = np.array([0.31, -1.2]), 0.99261
    for count in (1, 63, 64, 65, 2800):
        drive = rng.normal(size=(count, 2))
        expected, _ = lfilter([0.0, 1.0], [1.0, -decay], drive, axis=0, zi=start[None, :])
        found = first_order(start, drive, decay)
        assert np.abs(found[:-1] - expected).max() < 1e-12
        assert np.abs(found[-1] - decay * found[-2] - drive[-1]).max() < 1e-12


def test_plan_is_what_scipys_filters_give(case: Case) -> None:
    from scipy.signal import lfilter

    decay = np.exp(-OMEGA * GRID)
    plan, moves = case.plan, round(case.timing.initial_transfer / GRID)
    com, _ = lfilter([0, 1 - decay], [1, -decay], plan.dcm, axis=0, zi=START[None, :])
    assert np.abs(plan.com - com).max() < 1e-12
    reverse = plan.vrp[::-1]
    dcm, _ = lfilter([1 - decay], [1, -decay], reverse, axis=0, zi=decay * reverse[:1])
    # The initial transfer replaces the backward pass before its end.
    assert np.abs(plan.dcm - dcm[::-1])[moves + 1 :].max() < 1e-12


def test_dcm_runs_away_from_the_vrp(case: Case) -> None:
    plan = case.plan
    expected = (OMEGA * (plan.dcm - plan.vrp))[1:-1]
    # The VRP is held over each 2 ms; at up to 2.3 m/s that is an error of 9 mm/s.
    assert np.abs(_slope(plan.dcm) - expected).max() < 0.012
    assert np.abs(expected).max() > 0.3


def test_com_runs_after_the_dcm(case: Case) -> None:
    plan = case.plan
    expected = (OMEGA * (plan.dcm - plan.com))[1:-1]
    assert np.abs(_slope(plan.com) - expected).max() < 0.005
    assert np.abs(expected).max() > 0.2


def test_references_are_each_others_derivatives(case: Case) -> None:
    plan, h = case.plan, 1e-5
    # Midway between grid points and away from where the VRP bends.
    for time in np.arange(0.051, case.timing.initial_transfer + 1.0, 0.1):
        before, now, after = (plan.at(time + step) for step in (-h, 0.0, h))
        rate = (after.com - before.com) / (2 * h)
        assert np.abs(rate - now.com_velocity).max() < 0.005
        acceleration = (after.com_velocity - before.com_velocity) / (2 * h)
        assert np.abs(acceleration - now.com_acceleration).max() < 0.05


def test_starts_at_rest_where_the_references_are(case: Case) -> None:
    first = case.plan.at(0.0)
    assert np.array_equal(first.com, START)
    assert np.abs(first.dcm - START).max() < 1e-12
    assert np.abs(first.com_velocity).max() < 1e-12
    # DCM velocity zero: the VRP starts under the DCM, up to half a grid step of its motion.
    assert np.abs(first.vrp - first.dcm).max() < 1e-3
    assert np.abs(case.plan.dcm[1] - case.plan.dcm[0]).max() < 1e-5


def test_starts_from_a_com_that_still_lags_its_dcm() -> None:
    com = START + np.array([0.01, -0.02])
    plan = plan_dcm(com, START, STANCES, END, TIMINGS["normal"], OMEGA)
    assert np.array_equal(plan.at(0.0).com, com)
    assert np.abs(plan.at(0.0).com_velocity - OMEGA * (START - com)).max() < 1e-12
    other = plan_dcm(START, START, STANCES, END, TIMINGS["normal"], OMEGA)
    assert np.array_equal(plan.dcm, other.dcm)


def test_ends_at_rest(case: Case) -> None:
    t = case.timing
    moving = t.initial_transfer + 2 * t.single_support + t.double_support + t.final_transfer
    rest = case.plan.at(moving)
    assert np.abs(rest.dcm - END).max() < 1e-12
    assert case.plan.duration == pytest.approx(moving + t.settle + TAIL, abs=1e-9)
    last = case.plan.at(case.plan.duration)
    # e^(-w (settle + tail)) of the few centimetres that the CoM lagged.
    assert np.abs(last.com - END).max() < 1e-5
    assert np.abs(last.com_velocity).max() < 1e-4


def test_vrp_stays_on_the_standing_foot(case: Case) -> None:
    half_size = np.array([0.115, 0.065])
    for (start, end), stance in zip(case.swings, STANCES, strict=True):
        for time in np.arange(start, end, 0.01):
            assert (np.abs(case.plan.at(time).vrp - stance) < half_size).all()
        middle = case.plan.at(0.5 * (start + end))
        assert np.abs(middle.vrp - stance).max() < 1e-12


def test_vrp_stays_between_the_feet_during_the_first_transfer(case: Case) -> None:
    steps = round(case.timing.initial_transfer / GRID)
    offset = np.abs(case.plan.vrp[:steps] - START).max(axis=0)
    assert offset[0] < 0.115
    assert offset[1] < 0.14 + 0.065


def test_nothing_jumps(case: Case) -> None:
    plan = case.plan
    for track, speed in ((plan.com, 0.6), (plan.dcm, 0.9), (plan.vrp, 2.5)):
        # A jump is a step many times what the fastest of the tracks makes in one grid interval.
        assert np.abs(np.diff(track, axis=0)).max() < speed * GRID


def test_outside_the_plan_the_robot_rests(case: Case) -> None:
    plan = case.plan
    before, first = plan.at(-1.0), plan.at(0.0)
    assert np.array_equal(before.com, first.com)
    assert np.array_equal(before.dcm, first.dcm)
    beyond, last = plan.at(plan.duration + 100.0), plan.at(plan.duration)
    assert np.array_equal(beyond.com, last.com)
    assert np.abs(beyond.com - plan.com[-1]).max() == 0.0
    assert np.abs(beyond.com_acceleration).max() < 1e-3


def test_interpolates_between_grid_points(case: Case) -> None:
    plan = case.plan
    middle = plan.at(100.25 * GRID)
    assert np.abs(middle.com - (0.75 * plan.com[100] + 0.25 * plan.com[101])).max() < 1e-12


def test_smoothstep_is_flat_at_both_ends() -> None:
    share = np.array([0.0, 1e-4, 0.5, 1.0 - 1e-4, 1.0])
    assert smoothstep(share) == pytest.approx([0.0, 3e-8, 0.5, 1.0 - 3e-8, 1.0], abs=1e-11)
