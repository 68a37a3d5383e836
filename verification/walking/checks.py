"""The promises about standing, walking and reaching, as named checks with their limits."""

import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from common.schemas import Gait
from services.wbc.footsteps import gait_displacement
from verification.walking import measures
from verification.walking.measures import Numbers, random_gaits
from verification.walking.meetings import meetings, random_meetings
from verification.walking.stack import NOISE, Scenario

SIX = tuple(gait for gait in Gait if gait is not Gait.NONE)
MOMENTS = (0.09, 0.24, 0.33, 0.42, 0.51, 0.60, 0.69, 0.78)
"""Shares of a gait from the first transfer to the last, in both swings and between."""
SEEDS = range(4)
"""Of the runs in which the controller is silent during the forward gait."""
TRANSFER_AND_SWING = (1.5, 2.3, 2.8, 3.3)
"""Times in the first transfer, its swing, the second transfer and its swing [s]."""
REACH_TARGETS = ((0.42, 0.25, 0.20), (0.45, 0.22, 0.30), (0.36, 0.34, 0.05))
"""Left-hand targets in the body frame [m]; the right hand takes the mirror image."""
NOISY = Scenario(delay=0.01, noise=NOISE)
STANDING = Scenario()
STEPPING = Scenario(gaits=(Gait.FORWARD,))


@dataclass(frozen=True)
class Check:
    """A promise with its measurement and limits.

    Attributes:
        group: heading under which the promise stands.
        name: conditions of the promise.
        measure: runs the measurement; picklable, so that checks can run side by side.
        at_most: upper limits of the measured numbers.
        at_least: lower limits.
    """

    group: str
    name: str
    measure: Callable[[], Numbers]
    at_most: Mapping[str, float]
    at_least: Mapping[str, float] = field(default_factory=dict)

    def keeps(self, numbers: Numbers) -> bool:
        """Whether measured numbers keep all limits."""
        return all(float(numbers[name]) <= limit for name, limit in self.at_most.items()) and all(
            float(numbers[name]) >= limit for name, limit in self.at_least.items()
        )

    def describe(self, numbers: Numbers) -> str:
        """Return the measured numbers with their limits as one line."""
        limits = {name: f" (≤ {limit:.4g})" for name, limit in self.at_most.items()}
        limits |= {name: f" (≥ {limit:.4g})" for name, limit in self.at_least.items()}
        return ", ".join(
            f"{name} {value if isinstance(value, str) else f'{value:.4g}'}{limits.get(name, '')}"
            for name, value in numbers.items()
            if value != ""
        )


def measured(checks: Sequence[Check], index: int) -> tuple[Numbers, float]:
    """Run the measurement of a check in a worker; return its numbers and the time it took [s]."""
    # The checks stop services on purpose; their warnings are no news.
    logging.disable(logging.WARNING)
    start = time.perf_counter()
    return checks[index].measure(), time.perf_counter() - start


def walk_check(group: str, name: str, scenario: Scenario) -> Check:
    """Check that all gaits complete and end where commanded.

    Allowed are 2 cm for every 2 m and 2° for every 180° commanded, and never less than these.
    """
    moves = [gait_displacement(gait, scenario.wbc().gait) for gait in scenario.gaits]
    distance = sum(float(np.hypot(forward, left)) for forward, left, _ in moves)
    turn = sum(abs(turn) for _, _, turn in moves)
    limits = {
        "fell": 0.0,
        "position_error_m": 0.02 * max(1.0, distance / 2.0),
        "yaw_error_deg": 2.0 * max(1.0, turn / np.pi),
    }
    run = partial(measures.walk, scenario)
    return Check(group, name, run, limits, {"completed": len(scenario.gaits)})


def random_check(count: int) -> Check:
    """Check random gaits with wandering hands, delay and noise."""
    hands = measures.roaming_motion
    scenario = replace(NOISY, gaits=random_gaits(count, 7), hands=hands, seed=7)
    return walk_check("random gaits", f"{count} with hands moving", scenario)


def standing_silence(name: str, length: float, restart: bool) -> Check:
    """Check that the robot stays up, and that its joint commands do not jump."""
    run = partial(measures.silence, STANDING, 2.0, length, restart)
    return Check("silence", f"{name}, standing", run, {"fell": 0.0, "joint_step_rad": 0.05})


def walking_silence(
    name: str,
    length: float,
    scenarios: Sequence[Scenario],
    moments: Sequence[float] = MOMENTS,
    restart: bool = False,
) -> Check:
    """Check that the robot stays up when the controller stops in the middle of a gait."""
    run = partial(measures.silences, scenarios, moments, length, restart)
    return Check("silence", name, run, {"falls": 0.0})


def silence_checks() -> Iterator[Check]:
    """Check silences of every length, in every gait and at every pace.

    Those shorter than the guard's patience are without delay, for it counts like silence.
    """
    for name, length, restart in (
        ("90 ms silent", 0.09, False),
        ("1 s silent", 1.0, False),
        ("restarted after 0.5 s", 0.5, True),
    ):
        yield standing_silence(name, length, restart)
    yield walking_silence("90 ms silent, no delay", 0.09, (STEPPING,))
    forward = [replace(NOISY, gaits=(Gait.FORWARD,), seed=seed) for seed in SEEDS]
    for length in (0.5, 1.0, 3.0):
        yield walking_silence(f"{length:g} s silent, noisy", length, forward)
    yield walking_silence("restarted after 0.5 s, noisy", 0.5, forward, restart=True)
    for gait in SIX[1:]:
        row = (replace(NOISY, gaits=(gait,), seed=int(gait)),)
        yield walking_silence(f"1 s silent, noisy, {gait.name.lower()}", 1.0, row)
    for pace in ("fast", "slow", "public"):
        row = (replace(forward[0], pace=pace),)
        yield walking_silence(f"1 s silent, noisy, {pace}", 1.0, row)


def tracking_check(axis: int, gaits: tuple[Gait, ...], limit: float) -> Check:
    """Check that both hands follow 0.1 m at 0.5 Hz along one body axis."""
    run = partial(measures.tracking, Scenario(gaits=gaits, delay=0.01, tail=0.0), axis)
    name = f"0.1 m, 0.5 Hz along {'xyz'[axis]}, {'walking' if gaits else 'standing'}"
    return Check("hand tracking", name, run, {"mean_m": limit, "fell": 0.0})


def reach_check(target: tuple[float, float, float]) -> Check:
    """Check the static error two seconds after a reach."""
    run = partial(measures.static_reach, Scenario(delay=0.01), target)
    return Check("static reach", f"to {target}", run, {"position_m": 0.005, "rotation_deg": 2.0})


def meeting_checks(count: int, chunks: int) -> Iterator[Check]:
    """Check that no targets of the hands topple the robot; in chunks that can run side by side."""
    scenario = Scenario(delay=0.02, noise=NOISE)
    for chunk in range(chunks):
        run = partial(meetings, random_meetings(count, 2026)[chunk::chunks], scenario)
        name = f"{count} random meetings, part {chunk + 1} of {chunks}"
        yield Check("hands meet", name, run, {"falls": 0.0, "pressed": 10.0})


def determinism_check(count: int) -> Check:
    """Check that the same seed gives the same bytes and another seed does not."""
    hands = measures.roaming_motion
    scenario = replace(NOISY, gaits=random_gaits(count, 3), hands=hands, seed=3)
    run = partial(measures.determinism, scenario)
    return Check("determinism", "same seed, same bytes", run, {}, {"same": 1, "other_differs": 1})


def all_checks(gaits: int, random: int) -> Iterator[Check]:
    """Yield every check; ``gaits`` of each type in a row and ``random`` in one run."""
    for scenario in (NOISY, replace(NOISY, torque_mode="rated")):
        for gait in SIX:
            row = replace(scenario, gaits=(gait,) * gaits, seed=int(gait))
            yield walk_check(
                f"gaits, {scenario.torque_mode}", f"{gaits} × {gait.name.lower()}", row
            )
    yield random_check(random)
    for name, newtons, scenario, times in (
        ("100 N standing", 100.0, STANDING, (2.0,)),
        ("60 N walking", 60.0, STEPPING, TRANSFER_AND_SWING),
    ):
        yield Check(
            "pushes", name, partial(measures.pushes, scenario, newtons, times), {"falls": 0.0}
        )
    slow_loop = partial(measures.walk, Scenario(gaits=SIX, delay=0.03))
    yield Check("loop delay", "30 ms, six gaits", slow_loop, {"fell": 0.0}, {"completed": len(SIX)})
    yield from silence_checks()
    for axis in range(3):
        yield tracking_check(axis, (), 0.010)
        yield tracking_check(axis, (Gait.FORWARD, Gait.SIDE_LEFT, Gait.TURN_RIGHT), 0.020)
    yield from map(reach_check, REACH_TARGETS)
    yield from meeting_checks(300, 4)
    yield determinism_check(3)
