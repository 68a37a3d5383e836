"""Physics steps due, given the runner's clock."""

import numpy as np
import pytest

from services.sim.physics.pace import Pace, RateTimer

from .support import MS


def test_one_step_per_millisecond_in_simulated_time() -> None:
    pace = Pace(first_steps=1, catch_up_steps=20)
    assert [pace.due(k * MS) for k in range(5, 50)] == [1] * 45
    assert pace.late_steps == 0


def test_two_steps_per_period_of_two_milliseconds() -> None:
    pace = Pace(first_steps=2, catch_up_steps=20)
    assert [pace.due(k * 2 * MS) for k in range(10)] == [2] * 10


def test_jitter_below_half_a_step_neither_skips_nor_doubles() -> None:
    pace = Pace(first_steps=1, catch_up_steps=20)
    pace.due(0)
    jitter = np.random.default_rng(3).integers(-450_000, 450_000, 1000)
    assert [pace.due((k + 1) * MS + int(jitter[k])) for k in range(1000)] == [1] * 1000


def test_a_hiccup_is_caught_up_a_long_gap_is_not() -> None:
    pace = Pace(first_steps=1, catch_up_steps=20)
    pace.due(0)
    assert pace.due(8 * MS) == 8
    assert pace.late_steps == 0
    assert pace.due(508 * MS) == 20
    assert pace.late_steps == 480
    assert pace.due(509 * MS) == 1


def test_a_clock_that_stands_still_or_goes_back_asks_for_nothing() -> None:
    pace = Pace(first_steps=1, catch_up_steps=20)
    pace.due(100 * MS)
    assert pace.due(100 * MS) == 0
    assert pace.due(50 * MS) == 0
    assert pace.due(101 * MS) == 1


def test_skipped_time_is_not_made_up() -> None:
    pace = Pace(first_steps=1, catch_up_steps=20)
    pace.due(0)
    pace.skip(5000 * MS)
    assert pace.due(5001 * MS) == 1
    assert pace.late_steps == 0


@pytest.mark.parametrize(("rate", "expected"), [(50, 50), (10, 10), (1, 1)])
def test_every_keeps_its_rate(rate: int, expected: int) -> None:
    every = RateTimer(rate)
    assert sum(every.due(k * MS) for k in range(1000)) == expected


def test_every_keeps_its_phase_after_a_little_delay_and_drops_what_is_missed() -> None:
    every = RateTimer(50)
    assert every.due(0)
    assert every.due(25 * MS)
    assert not every.due(39 * MS)
    assert every.due(40 * MS)
    assert every.due(205 * MS)
    assert not every.due(206 * MS)
    assert every.due(225 * MS)
