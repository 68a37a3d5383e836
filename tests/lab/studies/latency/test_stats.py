import pytest

from lab.studies.latency.stats import bootstrap_mean, paired, summarise, wilson
from tests.lab.studies.latency.support import NAMES, row, rows


def test_wilson_interval_of_known_proportions() -> None:
    # Newcombe 1998, table I, method 3: 81 of 263, 15 of 148, 0 of 20, 1 of 29.
    assert wilson(81, 263) == pytest.approx((0.2553, 0.3662), abs=5e-5)
    assert wilson(15, 148) == pytest.approx((0.0624, 0.1605), abs=5e-5)
    assert wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=5e-5)
    assert wilson(1, 29) == pytest.approx((0.0061, 0.1718), abs=5e-5)
    assert wilson(20, 20)[1] == 1.0
    with pytest.raises(ValueError, match="0"):
        wilson(0, 0)


def test_bootstrap_of_a_mean() -> None:
    assert bootstrap_mean([3.0]) is None
    assert bootstrap_mean([3.0, 3.0, 3.0]) == (3.0, 3.0)
    values = [float(value) for value in range(101)]
    low, high = bootstrap_mean(values) or (0.0, 0.0)
    # Normal theory: 50 ± 1.96 * 29.15 / sqrt(101).
    assert (low, high) == pytest.approx((44.3, 55.7), abs=0.35)
    assert bootstrap_mean(values) == (low, high)


def test_a_cell_in_numbers() -> None:
    times = [(0, 6.0), (1, 7.0), (2, 8.0), (3, 13.0)]
    cell_rows = [row(seed=seed, time=time) for seed, time in times]
    cell_rows += [
        row(seed=4, time=9.0, verdict="partial", reached=True),
        row(seed=5, time=20.0, verdict="failure"),
        row(seed=6, time=3.0, verdict="failure"),
        row(seed=7, time=0.0, verdict="error"),
    ]
    (cell,) = summarise(cell_rows, NAMES, "interpolation")
    assert (cell.trials, cell.reached) == (8, 5)
    assert (cell.success, cell.partial, cell.failure) == (0.5, 0.125, 0.375)
    assert (cell.time_q1, cell.time_median, cell.time_q3) == (7.0, 8.0, 9.0)
    assert cell.time_mean == pytest.approx(8.6)
    # 43 s of those that reached the goal and three times the limit of 20 s.
    assert cell.charged_mean == pytest.approx((43.0 + 60.0) / 8)
    assert cell.success_interval == pytest.approx(wilson(4, 8))
    assert cell.command == pytest.approx(0.255)
    assert cell.difference is None


def test_differences_are_of_trials_with_the_same_start() -> None:
    before = [row(seed=seed, time=5.0 + seed) for seed in range(4)]
    late = [
        row("latency-250", 0, 7.0),
        row("latency-250", 1, 6.5),
        row("latency-250", 3, 20.0, "failure"),
        row("latency-250", 2, 0.0, "error"),
        row("latency-250", 9, 1.0),
    ]
    found = paired(late, before)
    assert found is not None
    assert found.pairs == 3
    assert found.mean == pytest.approx((2.0 + 0.5 + 12.0) / 3)
    assert paired(late, []) is None


def test_operators_are_never_pooled() -> None:
    human = [
        row("raw", seed, 30.0, operator="human", participant="P01", limit=40.0) for seed in (0, 1)
    ]
    cells = summarise([*rows({"raw": 8.0, "interpolation": 9.0}), *human], NAMES, "interpolation")
    assert [(c.operator, c.condition, c.trials) for c in cells] == [
        ("synthetic", "raw", 6),
        ("synthetic", "interpolation", 6),
        ("human", "raw", 2),
    ]
    assert cells[0].difference is not None
    assert cells[0].difference.mean == pytest.approx(-1.0)
    assert cells[2].time_mean == 30.0
    assert cells[2].difference is None


def test_a_cell_without_a_completed_trial() -> None:
    (cell,) = summarise([row(verdict="failure", time=20.0)], NAMES, "interpolation")
    assert cell.time_median is None
    assert cell.flat()["time_interval_low"] is None
    assert cell.charged_mean == 20.0
