"""How a row of the comparison of two builds is judged and shown."""

import pytest

from benchmarks.comparison import ROWS, Bound, Row, judge, table
from benchmarks.rounds import PLACO, WORKLOADS

FASTER = Row("time", "speed", "walking.speed", more=True, must=Bound(1.7), aim=Bound(2.2))
TAIL = Row("tail", "p99 / median", "tick.p99", "tick.median", must=Bound(1.6, absolute=True))


def rounds(metric: str, *values: float) -> list[dict[str, float]]:
    return [{metric: value} for value in values]


def test_a_ratio_is_the_median_of_the_rounds_own_ratios() -> None:
    # The machine was three times slower in the third round, for both builds alike.
    old, new = (4.0, 4.2, 1.3, 4.1, 4.0), (7.2, 7.4, 2.6, 7.0, 8.0)
    result = judge(FASTER, rounds("walking.speed", *old), rounds("walking.speed", *new))
    assert (result.old, result.new) == (4.0, 7.2)
    assert result.ratio == pytest.approx(1.8)
    assert result.low == pytest.approx(7.0 / 4.1)
    assert result.high == pytest.approx(2.0)
    assert (result.kept, result.aimed) == (True, False)
    assert result.verdict == "kept, aim not reached"


@pytest.mark.parametrize(
    ("more", "ratio", "kept"),
    [(True, 1.7, True), (True, 1.69, False), (False, 1.7, True), (False, 1.71, False)],
)
def test_a_bound_is_kept_on_its_own_side(more: bool, ratio: float, kept: bool) -> None:
    row = Row("tick", "tick", "tick.median", more=more, must=Bound(1.7))
    result = judge(row, rounds("tick.median", 1.0), rounds("tick.median", ratio))
    assert result.kept is kept
    assert result.verdict == ("kept" if kept else "missed")


def test_an_absolute_bound_looks_at_the_new_build_alone() -> None:
    old = [{"tick.p99": 0.3, "tick.median": 0.1}]
    new = [{"tick.p99": 0.9, "tick.median": 0.6}]
    result = judge(TAIL, old, new)
    assert result.old == pytest.approx(3.0)
    assert result.new == pytest.approx(1.5)
    assert result.kept
    assert judge(TAIL, new, old).verdict == "missed"


def test_no_misses_at_all_can_be_asked_for() -> None:
    row = Row("cameras", "misses", "live.misses", must=Bound(0.0, absolute=True))
    result = judge(row, rounds("live.misses", 0.0, 3.0), rounds("live.misses", 0.0, 0.0))
    assert (result.new, result.ratio, result.kept) == (0.0, 0.0, True)
    assert not judge(row, rounds("live.misses", 9.0), rounds("live.misses", 1.0)).kept


def test_what_was_not_measured_is_not_kept() -> None:
    result = judge(FASTER, rounds("walking.speed", 4.0), [{}])
    assert (result.kept, result.ratio, result.verdict) == (False, None, "not measured")
    assert judge(FASTER, [{}], rounds("walking.speed", 9.0)).kept is False
    shown_only = Row("memory", "PSS", "live.pss_mb")
    assert judge(shown_only, [{}], [{}]).kept is None


def test_a_round_that_failed_leaves_the_others() -> None:
    old = [*rounds("walking.speed", 4.0, 4.0), {}]
    result = judge(FASTER, old, rounds("walking.speed", 8.0, 8.8, 8.0))
    assert result.ratio == pytest.approx(2.1)
    assert result.kept


def test_the_table_says_everything_in_columns() -> None:
    result = judge(FASTER, rounds("walking.speed", 4.0, 4.0), rounds("walking.speed", 8.8, 9.2))
    head, line = table([result])
    assert head.index("old") + len("old") == line.index("4  ") + 1
    assert line.split() == [
        *("time", "speed", "4", "9", "2.25", "×", "2.20–2.30", "≥", "1.7", "×", "≥", "2.2", "×"),
        *("kept,", "aim", "reached"),
    ]


def test_every_row_of_the_table_has_a_workload() -> None:
    names = {name.partition(".")[0] for row in ROWS for name in (row.metric, row.per) if name}
    assert names == {*WORKLOADS, PLACO}
