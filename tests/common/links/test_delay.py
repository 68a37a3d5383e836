"""The delay line does what its link specification says, to the nanosecond, and says what it did."""

import itertools
import math
import statistics

import pytest

from common.links.delay import DelayLine, DelayStats, Released
from common.links.spec import Distribution, LinkSpec

MS = 1_000_000


def run(
    text: str, interval_ns: int, count: int, seed: int = 0
) -> tuple[list[Released[int]], DelayStats]:
    """Push ``count`` numbers at a fixed interval and release everything on time."""
    line: DelayLine[int] = DelayLine(LinkSpec.parse(text), seed)
    released = []
    for number in range(count):
        now = number * interval_ns
        while line.next_due_ns <= now:
            released += line.pop(line.next_due_ns)
        line.push(number, now)
    while len(line):
        released += line.pop(line.next_due_ns)
    return released, line.stats()


def test_constant_delay_is_exact() -> None:
    line: DelayLine[str] = DelayLine(LinkSpec.parse("250ms"))
    line.push("a", 10)
    line.push("b", 20)
    assert line.next_due_ns == 250 * MS + 10
    assert line.pop(250 * MS + 9) == []
    assert line.pop(250 * MS + 10) == [Released(250 * MS + 10, 250 * MS, "a")]
    assert line.pop(250 * MS + 19) == []
    assert line.pop(300 * MS) == [Released(250 * MS + 20, 250 * MS, "b")]
    assert len(line) == 0
    assert line.pop(10**18) == []


def test_no_delay_passes_at_once_in_order() -> None:
    line: DelayLine[int] = DelayLine(LinkSpec.parse("0"))
    for number in range(5):
        line.push(number, 7)
    assert [item for _, _, item in line.pop(7)] == [0, 1, 2, 3, 4]


def test_same_seed_same_delays_other_seed_others() -> None:
    text = "lognormal(122ms, 190ms) loss=10%"
    first, _ = run(text, 50 * MS, 300, seed=3)
    assert run(text, 50 * MS, 300, seed=3)[0] == first
    assert run(text, 50 * MS, 300, seed=4)[0] != first
    assert run(f"{text} seed=3", 50 * MS, 300, seed=99)[0] == first


def test_loss_leaves_the_delays_of_the_others_alone() -> None:
    base = {item: due for due, _, item in run("normal(80ms, 20ms) order=free", 10 * MS, 2000)[0]}
    lossy, stats = run("normal(80ms, 20ms) order=free loss=25%", 10 * MS, 2000)
    assert all(base[item] == due for due, _, item in lossy)
    assert stats.lost == 2000 - len(lossy)
    # Binomial: 500 expected, standard deviation 19.4.
    assert abs(stats.lost - 500) < 78


def test_total_loss_lets_nothing_through() -> None:
    released, stats = run("5ms loss=1", MS, 50)
    assert released == []
    assert (stats.pushed, stats.lost) == (50, 50)
    assert stats.achieved_mean == 0.0


def test_normal_delays_have_the_requested_moments() -> None:
    released, stats = run("normal(250ms, 20ms) order=free", 2 * MS, 20_000)
    delays = [1e-9 * injected for _, injected, _ in released]
    assert statistics.fmean(delays) == pytest.approx(0.250, abs=0.0006)
    assert statistics.stdev(delays) == pytest.approx(0.020, abs=0.0005)
    assert stats.achieved_mean == pytest.approx(stats.drawn_mean, abs=1e-12)
    assert stats.requested_mean == 0.250
    assert stats.requested_p99 == pytest.approx(0.250 + 2.3263 * 0.020, abs=1e-5)


def test_lognormal_is_parametrised_by_its_own_moments() -> None:
    released, stats = run("lognormal(122ms, 60ms) order=free", 2 * MS, 40_000)
    delays = [1e-9 * injected for _, injected, _ in released]
    assert statistics.fmean(delays) == pytest.approx(0.122, abs=0.0015)
    assert statistics.stdev(delays) == pytest.approx(0.060, abs=0.002)
    assert statistics.quantiles(delays, n=100)[98] == pytest.approx(stats.requested_p99, rel=0.04)


def test_clamping_at_zero_shows_in_the_statistics() -> None:
    released, stats = run("normal(122ms, 190ms) order=free", 50 * MS, 20_000)
    assert min(injected for _, injected, _ in released) == 0
    # E[max(0, X)] = mu Phi(mu/s) + s phi(mu/s).
    z = 122 / 190
    expected = 0.122 * 0.5 * math.erfc(-z / math.sqrt(2)) + 0.190 * math.exp(
        -0.5 * z * z
    ) / math.sqrt(2 * math.pi)
    assert stats.requested_mean == 0.122
    assert stats.drawn_mean == pytest.approx(expected, abs=0.004)


def test_order_is_kept_and_the_bias_is_reported() -> None:
    released, stats = run("normal(250ms, 20ms)", 2 * MS, 20_000)
    assert [item for _, _, item in released] == list(range(20_000))
    assert stats.held_back > 15_000
    assert stats.drawn_mean == pytest.approx(0.250, abs=0.0006)
    assert 0.268 < stats.achieved_mean < 0.280


def test_free_order_lets_messages_overtake() -> None:
    released, stats = run("normal(250ms, 20ms) order=free", 2 * MS, 2000)
    items = [item for _, _, item in released]
    assert items != sorted(items)
    assert sorted(items) == list(range(2000))
    assert stats.held_back == 0
    assert [due for due, _, _ in released] == sorted(due for due, _, _ in released)


def test_correlated_jitter_keeps_distribution_and_removes_the_bias() -> None:
    released, stats = run("normal(250ms, 20ms) corr=2s", 10 * MS, 40_000)
    delays = [1e-9 * injected for _, injected, _ in released]
    # 400 s of a process with a time constant of 2 s: about 100 independent draws.
    assert statistics.fmean(delays) == pytest.approx(0.250, abs=0.008)
    assert statistics.stdev(delays) == pytest.approx(0.020, abs=0.005)
    assert stats.achieved_mean - stats.drawn_mean < 0.002
    step = 50  # 0.5 s
    pairs = list(zip(delays, delays[step:], strict=False))
    correlation = statistics.correlation(*zip(*pairs, strict=True))
    assert correlation == pytest.approx(math.exp(-0.5 / 2.0), abs=0.1)


def test_trace_is_played_in_order_and_repeats() -> None:
    spec = LinkSpec.model_validate(
        {"distribution": "trace", "trace": [0.003, 0.001, 0.002], "keep_order": False}
    )
    line: DelayLine[int] = DelayLine(spec)
    for number in range(5):
        line.push(number, 0)
    assert line.pop(10 * MS) == [
        Released(MS, MS, 1),
        Released(MS, MS, 4),
        Released(2 * MS, 2 * MS, 2),
        Released(3 * MS, 3 * MS, 0),
        Released(3 * MS, 3 * MS, 3),
    ]
    assert line.stats().requested_mean == pytest.approx(0.002)
    assert line.stats().requested_p99 == 0.003


def test_empty_line_reports_zeros() -> None:
    stats = DelayLine[int](LinkSpec.parse("5ms")).stats()
    assert (stats.pushed, stats.achieved_p99, stats.requested_mean) == (0, 0.0, 0.005)


FRAME = 50 * MS


def eye(
    text: str, frames: list[int], skew_ns: int = 0, seed: int = 5
) -> tuple[dict[int, int], DelayStats]:
    """Push the frames of those numbers through one eye's line; delay by frame."""
    line: DelayLine[int] = DelayLine(LinkSpec.parse(text), seed, frame_ns=FRAME)
    delays: dict[int, int] = {}
    for number in frames:
        now = number * FRAME + skew_ns
        delays |= {item: injected for _, injected, item in line.pop(now)}
        line.push(number, now, captured_ns=number * FRAME + 1)
    delays |= {item: injected for _, injected, item in line.pop(2**62)}
    return delays, line.stats()


@pytest.mark.parametrize("jitter", ["lognormal(122ms, 90ms)", "normal(122ms, 60ms) corr=500ms"])
def test_both_eyes_share_delay_and_loss_of_a_frame(jitter: str) -> None:
    text = f"{jitter} order=free loss=20%"
    left, _ = eye(text, list(range(1000)))
    # The other eye comes a little later, starts later and misses frames.
    seen = [number for number in range(300, 1000) if number % 7]
    right, _ = eye(text, seen, skew_ns=3 * MS)
    assert {number: left[number] for number in left if number in set(seen)} == right
    assert 430 < len(right) < 530
    assert eye(text, seen, seed=6)[0] != right


def test_held_back_eyes_stay_together() -> None:
    text = "normal(122ms, 90ms)"
    left, stats = eye(text, list(range(2000)))
    right, _ = eye(text, list(range(2000)), skew_ns=3 * MS)
    assert stats.held_back > 500
    assert max(abs(left[number] - right[number]) for number in left) <= 3 * MS


def test_drawing_by_time_has_the_requested_moments_and_correlation() -> None:
    delays, _ = eye("normal(250ms, 20ms) corr=2s", list(range(20_000)))
    ordered = [1e-9 * delays[number] for number in range(20_000)]
    # 1000 s of a process with a time constant of 2 s: about 250 independent draws.
    assert statistics.fmean(ordered) == pytest.approx(0.250, abs=0.006)
    assert statistics.stdev(ordered) == pytest.approx(0.020, abs=0.003)
    pairs = list(zip(ordered, ordered[10:], strict=False))  # 0.5 s
    assert statistics.correlation(*zip(*pairs, strict=True)) == pytest.approx(
        math.exp(-0.5 / 2.0), abs=0.08
    )
    free, _ = eye("normal(250ms, 20ms) order=free", list(range(5000)))
    alone = [1e-9 * delay for delay in free.values()]
    assert statistics.fmean(alone) == pytest.approx(0.250, abs=0.0012)
    assert statistics.stdev(alone) == pytest.approx(0.020, abs=0.001)
    following = list(itertools.pairwise(alone))
    assert abs(statistics.correlation(*zip(*following, strict=True))) < 0.06


def test_trace_of_frames_goes_by_capture_time() -> None:
    spec = LinkSpec.model_validate({"distribution": "trace", "trace": [0.01, 0.03, 0.02]})
    line: DelayLine[int] = DelayLine(spec, 0, frame_ns=FRAME)
    for number in (0, 1, 4, 5):
        line.push(number, number * FRAME, captured_ns=number * FRAME)
    delays = {item: injected // MS for _, injected, item in line.pop(2**62)}
    assert delays == {0: 10, 1: 30, 4: 30, 5: 20}


def test_adopted_messages_keep_their_times_and_stay_in_front() -> None:
    old: DelayLine[str] = DelayLine(LinkSpec.parse("100ms"))
    old.push("a", 0)
    old.push("b", 10 * MS)
    new: DelayLine[str] = DelayLine(LinkSpec.parse("5ms"))
    new.adopt(old)
    new.push("c", 20 * MS)
    assert new.pop(109 * MS) == [Released(100 * MS, 100 * MS, "a")]
    assert [item for _, _, item in new.pop(110 * MS)] == ["b", "c"]
    assert new.stats().pushed == 1
    assert new.stats().achieved_mean == pytest.approx(0.09)


def test_achieved_p99_is_of_the_last_ten_thousand() -> None:
    count = 12_345
    delays = tuple(1e-6 * (count - number) for number in range(count))
    line: DelayLine[int] = DelayLine(LinkSpec(distribution=Distribution.TRACE, trace=delays))
    for number in range(count):
        line.push(number, number * 20 * MS)
        line.pop(number * 20 * MS + 19 * MS)
    # Of 10 000, 9999, ..., 1 us.
    assert line.stats().achieved_p99 == pytest.approx(9.9e-3)
