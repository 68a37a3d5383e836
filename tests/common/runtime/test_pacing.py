"""When steps are due: no bursts, no drift, one step a period, locked to the arrivals."""

import random

from common.runtime.live.pacing import ClockPace, TriggerPace

MS = 1_000_000


def test_clock_keeps_its_grid() -> None:
    pace = ClockPace(10 * MS, 5)
    for step in range(4):
        assert pace.due_ns == 5 + 10 * MS * step
        assert not pace.ended(pace.due_ns + 3 * MS)


def test_late_step_is_followed_at_once_and_the_grid_stays() -> None:
    pace = ClockPace(10 * MS, 0)
    assert pace.ended(14 * MS)
    assert pace.due_ns == 10 * MS
    assert not pace.ended(18 * MS)
    assert pace.due_ns == 20 * MS


def test_long_stall_makes_no_burst() -> None:
    pace = ClockPace(10 * MS, 0)
    now = 503 * MS
    assert pace.ended(now)
    assert pace.due_ns == 500 * MS
    assert not pace.ended(now + MS)
    assert pace.due_ns == 510 * MS


def steps_of(pace: TriggerPace, arrivals: list[int]) -> list[int]:
    return [arrival for arrival in arrivals if pace.accepts(arrival)]


def test_first_arrival_starts_a_step_and_every_second_follows() -> None:
    pace = TriggerPace(10 * MS, 5 * MS, 0)
    arrivals = [3 * MS + 5 * MS * k for k in range(20)]
    assert steps_of(pace, arrivals) == arrivals[::2]


def test_jitter_does_not_change_which_arrivals_count() -> None:
    rng = random.Random(1)
    pace = TriggerPace(10 * MS, 5 * MS, 0)
    exact = [5 * MS * k for k in range(2000)]
    arrivals = [t + round(rng.uniform(-0.2, 0.2) * 5 * MS) for t in exact]
    assert steps_of(pace, arrivals) == arrivals[::2]


def test_one_late_arrival_does_not_shift_the_phase() -> None:
    pace = TriggerPace(10 * MS, 5 * MS, 0)
    arrivals = [5 * MS * k for k in range(40)]
    arrivals[10] += 4 * MS
    assert steps_of(pace, arrivals) == arrivals[::2]


def test_phase_follows_a_slow_drift() -> None:
    pace = TriggerPace(10 * MS, 10 * MS, 0)
    # 2 % slow sender: every arrival still starts exactly one step.
    arrivals = [round(10.2 * MS * k) for k in range(1000)]
    assert steps_of(pace, arrivals) == arrivals


def test_faster_sender_is_limited_to_one_step_a_period() -> None:
    pace = TriggerPace(10 * MS, 5 * MS, 0)
    arrivals = [1 * MS * k for k in range(10_000)]
    steps = steps_of(pace, arrivals)
    # A flood can pull the phase by a tenth of the tolerance in each period: 2.5 %.
    assert 1000 <= len(steps) <= 1026


def test_without_arrivals_a_step_comes_after_one_and_a_half_periods() -> None:
    pace = TriggerPace(10 * MS, 5 * MS, 0)
    assert pace.due_ns == 15 * MS
    assert pace.accepts(2 * MS)
    assert pace.due_ns == 17 * MS
    pace.timed_out(17 * MS)
    assert pace.due_ns == 32 * MS


def test_arrival_right_after_a_timeout_waits_its_turn() -> None:
    pace = TriggerPace(10 * MS, 10 * MS, 0)
    assert pace.accepts(0)
    pace.timed_out(15 * MS)
    assert not pace.accepts(16 * MS)
    assert pace.accepts(26 * MS)


def test_silence_makes_the_lock_start_over() -> None:
    pace = TriggerPace(10 * MS, 5 * MS, 0)
    assert pace.accepts(0)
    assert pace.accepts(1003 * MS)
    assert not pace.accepts(1006 * MS)
    assert pace.accepts(1013 * MS)


def test_trigger_deadline_is_one_period() -> None:
    pace = TriggerPace(10 * MS, 5 * MS, 0)
    assert not pace.ended(25 * MS, 15 * MS)
    assert pace.ended(25 * MS + 1, 15 * MS)
