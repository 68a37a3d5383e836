"""The clock estimator against simulated networks and clocks whose truth is known."""

import random
from collections.abc import Callable

import pytest

from common.runtime.live.offset_estimator import MAX_DRIFT, Exchange, Offset, OffsetEstimator

MS = 1_000_000
SECOND = 1_000_000_000

Delay = Callable[[], float]
"""Draws a one-way delay [s]."""


class World:
    """Two clocks and a network between them; ``truth`` is this clock minus the other [ns]."""

    def __init__(self, offset_s: float, there: Delay, back: Delay, drift: float = 0.0) -> None:
        self.offset = round(offset_s * SECOND)
        self.there, self.back, self.drift = there, back, drift
        self.now = 77 * SECOND

    @property
    def truth(self) -> int:
        return self.offset - round(self.drift * (self.now - 77 * SECOND))

    def other(self) -> int:
        return self.now - self.truth

    def exchange(self) -> Exchange:
        asked = self.now
        self.now += round(self.there() * SECOND)
        received = self.other()
        self.now += 30_000
        answered = self.other()
        self.now += round(self.back() * SECOND)
        return Exchange(asked, received, answered, self.now)


def constant(seconds: float) -> Delay:
    return lambda: seconds


def heavy(seed: int, median: float) -> Delay:
    draw = random.Random(seed)
    return lambda: median * draw.paretovariate(1.2)


def known(estimator: OffsetEstimator, world: World) -> Offset:
    estimate = estimator.estimate(world.now)
    assert estimate is not None
    return estimate


@pytest.mark.parametrize("skew", [-0.2, 0.0, 0.2])
@pytest.mark.parametrize(
    ("there", "back"),
    [
        (constant(0.0002), constant(0.0002)),
        (constant(0.050), constant(0.001)),
        (constant(0.0), constant(0.120)),
        (heavy(1, 0.001), heavy(2, 0.001)),
        (heavy(3, 0.020), constant(0.0005)),
    ],
)
def test_error_never_exceeds_half_the_best_round_trip(
    skew: float, there: Delay, back: Delay
) -> None:
    world, estimator = World(skew, there, back), OffsetEstimator()
    trips = []
    for number in range(200):
        exchange = world.exchange()
        trips.append(exchange.round_trip)
        assert estimator.add(exchange)
        estimate = known(estimator, world)
        assert abs(estimate.offset - world.truth) <= estimate.error
        # No worse than the newest; on a quiet clock no worse than the best of the window.
        assert estimate.error <= exchange.round_trip // 2 + 1
        best = min(trips[-16:])
        age = number * SECOND
        assert abs(estimate.offset - world.truth) <= best // 2 + 1 + MAX_DRIFT * age
        world.now += SECOND
    assert estimator.steps == 0


def test_the_fastest_exchange_of_the_window_counts() -> None:
    delays = iter([0.3, 0.010, 0.3, 0.3])
    world = World(0.2, lambda: next(delays), constant(0.0))
    estimator = OffsetEstimator()
    for _ in range(4):
        estimator.add(world.exchange())
    estimate = known(estimator, world)
    assert estimate.error <= 5 * MS + MAX_DRIFT * SECOND
    assert abs(estimate.offset - world.truth) <= estimate.error


@pytest.mark.parametrize("drift", [100e-6, -100e-6])
def test_drift_is_followed_and_is_no_step(drift: float) -> None:
    world = World(-0.2, heavy(5, 0.0005), heavy(6, 0.0005), drift)
    estimator = OffsetEstimator()
    for _ in range(600):
        estimator.add(world.exchange())
        world.now += SECOND
        estimate = known(estimator, world)
        assert abs(estimate.offset - world.truth) <= estimate.error
    assert estimator.steps == 0
    # 60 ms have gone by; an estimator that stood still would be off by that.
    assert abs(estimate.offset - world.truth) < 3 * MS


@pytest.mark.parametrize("step", [0.150, -1.0])
@pytest.mark.parametrize("delay", [0.0003, 0.040])
def test_a_step_is_adopted_by_the_next_exchange(step: float, delay: float) -> None:
    world, estimator = World(0.05, constant(delay), constant(delay)), OffsetEstimator()
    for _ in range(30):
        estimator.add(world.exchange())
        world.now += SECOND
    world.offset -= round(step * SECOND)  # the other clock is ahead by the step from now on
    estimator.add(world.exchange())
    estimate = known(estimator, world)
    assert estimator.steps == 1
    assert abs(estimate.offset - world.truth) <= estimate.error


def test_a_step_hidden_by_slow_exchanges_is_found_by_a_fast_one() -> None:
    delays = iter([0.001, *[0.5] * 3, 0.001])
    world = World(0.0, lambda: next(delays), constant(0.0))
    estimator = OffsetEstimator()
    estimator.add(world.exchange())
    world.offset += 150 * MS
    for _ in range(3):
        estimator.add(world.exchange())
        world.now += SECOND
    estimator.add(world.exchange())
    assert estimator.steps == 1
    assert abs(known(estimator, world).offset - world.truth) <= known(estimator, world).error


def test_lost_exchanges_only_make_the_bound_wider() -> None:
    world, estimator = World(0.2, constant(0.001), constant(0.001), 100e-6), OffsetEstimator()
    estimator.add(world.exchange())
    before = known(estimator, world)
    world.now += 60 * SECOND
    after = known(estimator, world)
    assert after.offset == before.offset
    assert after.error == pytest.approx(before.error + 60 * SECOND * MAX_DRIFT, abs=2)
    assert abs(after.offset - world.truth) <= after.error
    estimator.add(world.exchange())
    assert known(estimator, world).error < 2 * MS
    assert estimator.steps == 0


@pytest.mark.parametrize(
    "damaged",
    [
        Exchange(asked=0, received=0, answered=10 * SECOND, returned=SECOND),
        Exchange(asked=SECOND, received=5, answered=5, returned=0),
    ],
)
def test_times_that_contradict_themselves_are_not_used(damaged: Exchange) -> None:
    estimator = OffsetEstimator()
    assert not estimator.add(damaged)
    assert estimator.estimate(0) is None
