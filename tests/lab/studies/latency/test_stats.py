import subprocess
import sys

import pytest

from lab.studies.latency.stats import paired_difference, summarise
from lab.trials.estimates import mean_estimate, proportion
from tests.lab.studies.latency.support import NAMES, trial, trials


def interval(count: int, total: int) -> tuple[float, float]:
    estimate = proportion(count, total)
    return estimate.low, estimate.high


def test_wilson_interval_of_known_proportions() -> None:
    # Newcombe 1998, table I, method 3: 81 of 263, 15 of 148, 0 of 20, 1 of 29.
    assert interval(81, 263) == pytest.approx((0.2553, 0.3662), abs=5e-5)
    assert interval(15, 148) == pytest.approx((0.0624, 0.1605), abs=5e-5)
    assert interval(0, 20) == pytest.approx((0.0, 0.1611), abs=5e-5)
    assert interval(1, 29) == pytest.approx((0.0061, 0.1718), abs=5e-5)
    assert interval(20, 20)[1] == 1.0
    assert proportion(81, 263).share == pytest.approx(81 / 263)
    with pytest.raises(ValueError, match="n must be"):
        interval(0, 0)


def test_bootstrap_of_a_mean() -> None:
    assert (mean_estimate([]).mean, mean_estimate([]).count) == (None, 0)
    one, same = mean_estimate([3.0]), mean_estimate([3.0, 3.0, 3.0])
    assert (one.mean, one.low, one.high, one.count) == (3.0, None, None, 1)
    assert (same.mean, same.low, same.high, same.count) == (3.0, 3.0, 3.0, 3)
    values = [float(value) for value in range(101)]
    found = mean_estimate(values)
    # Normal theory: 50 ± 1.96 * 29.15 / sqrt(101).
    assert (found.mean, found.low, found.high) == pytest.approx((50.0, 44.3, 55.7), abs=0.35)
    assert mean_estimate(values) == found
    assert found.text(".0f") == "50 [44, 56]"


def test_only_a_report_imports_the_statistics() -> None:
    program = (
        "import sys, lab.cli.main\n"
        "assert 'scipy.stats' not in sys.modules\n"
        "import lab.studies.latency.run, lab.studies.latency.human_trials\n"
        "assert 'lab.studies.latency.stats' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_a_cell_in_numbers() -> None:
    times = [(0, 6.0), (1, 7.0), (2, 8.0), (3, 13.0)]
    mixed = [trial(seed=seed, time=time) for seed, time in times]
    mixed += [
        trial(seed=4, time=9.0, verdict="partial", reached=True),
        trial(seed=5, time=20.0, verdict="failure"),
        trial(seed=6, time=3.0, verdict="failure"),
        trial(seed=7, time=0.0, verdict="error"),
    ]
    (cell,) = summarise(mixed, NAMES, "interpolation")
    assert (cell.trials, cell.time.count) == (8, 5)
    assert (cell.success.share, cell.partial, cell.failure) == (0.5, 0.125, 0.375)
    assert (cell.time_q1, cell.time_median, cell.time_q3) == (7.0, 8.0, 9.0)
    assert cell.time.mean == pytest.approx(8.6)
    # 43 s of those that reached the goal and three times the limit of 20 s.
    assert cell.charged_mean == pytest.approx((43.0 + 60.0) / 8)
    assert cell.success == proportion(4, 8)
    assert cell.command.mean == pytest.approx(0.255)
    assert cell.difference.mean is None


def test_differences_are_of_trials_with_the_same_start() -> None:
    before = [trial(seed=seed, time=5.0 + seed) for seed in range(4)]
    late = [
        trial("latency-250", 0, 7.0),
        trial("latency-250", 1, 6.5),
        trial("latency-250", 3, 20.0, "failure"),
        trial("latency-250", 2, 0.0, "error"),
        trial("latency-250", 9, 1.0),
    ]
    found = paired_difference(late, before)
    assert found.count == 3
    assert found.mean == pytest.approx((2.0 + 0.5 + 12.0) / 3)
    assert paired_difference(late, []).mean is None


def test_operators_are_never_pooled() -> None:
    human = [
        trial("raw", seed, 30.0, operator="human", participant="P01", limit=40.0) for seed in (0, 1)
    ]
    cells = summarise([*trials({"raw": 8.0, "interpolation": 9.0}), *human], NAMES, "interpolation")
    assert [(c.operator, c.condition, c.trials) for c in cells] == [
        ("synthetic", "raw", 6),
        ("synthetic", "interpolation", 6),
        ("human", "raw", 2),
    ]
    assert cells[0].difference.mean == pytest.approx(-1.0)
    assert cells[2].time.mean == 30.0
    assert cells[2].difference.count == 0


def test_a_cell_without_a_completed_trial() -> None:
    (cell,) = summarise([trial(verdict="failure", time=20.0)], NAMES, "interpolation")
    assert cell.time_median is None
    assert cell.time.text(".1f") == "none"
    assert cell.charged_mean == 20.0
