"""The promises about standing, walking and reaching, as named checks with their limits."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from common.schemas import Gait
from verification.walking import measures
from verification.walking.measures import SINE, push, random_gaits, silence, walk
from verification.walking.stack import NOISE, Scenario, Stack

SIX = tuple(gait for gait in Gait if gait is not Gait.NONE)
MOMENTS = (1.5, 2.0, 2.3, 2.6, 2.9, 3.2, 3.5, 3.8)
"""Times from the first transfer to the last, in both swings and between [s]."""
REACH_TARGETS = ((0.42, 0.25, 0.20), (0.45, 0.22, 0.30), (0.36, 0.34, 0.05))
"""Left-hand targets in the body frame [m]; the right hand takes the mirror image."""


@dataclass(frozen=True)
class Outcome:
    """What a check found: a line for people, numbers for machines."""

    passed: bool
    text: str
    numbers: dict[str, float]


@dataclass(frozen=True)
class Check:
    """One named promise; ``run`` is picklable so that checks can run side by side."""

    group: str
    name: str
    run: Callable[[], Outcome]


def gait_check(gait: Gait, count: int, scenario: Scenario) -> Outcome:
    """``count`` gaits of one type: no fall, final stance within tolerance."""
    result = walk(replace(scenario, gaits=(gait,) * count, seed=int(gait)))
    return Outcome(
        result.within_tolerance and result.completed == count,
        f"{result.completed}/{count} gaits, {'FELL' if result.fell else 'no fall'}, off by "
        f"{1e3 * result.position_error:.1f} mm (≤ {1e3 * result.position_allowance:.0f}), "
        f"{np.degrees(result.yaw_error):.2f}° (≤ {np.degrees(result.yaw_allowance):.0f})",
        {
            "completed": result.completed,
            "fell": float(result.fell),
            "position_error_m": result.position_error,
            "yaw_error_deg": float(np.degrees(result.yaw_error)),
            "unsolved": result.unsolved,
            "saturated": result.saturated,
        },
    )


def random_check(count: int, seed: int) -> Outcome:
    """``count`` random gaits with wandering hands, delay and noise."""
    scenario = Scenario(
        gaits=random_gaits(count, seed),
        delay=0.01,
        noise=NOISE,
        hands=measures.roaming_motion,
        seed=seed,
    )
    result = walk(scenario)
    return Outcome(
        result.within_tolerance and result.completed == count,
        f"{result.completed}/{count} gaits, {'FELL' if result.fell else 'no fall'}, off by "
        f"{1e3 * result.position_error:.1f} mm, {np.degrees(result.yaw_error):.2f}°",
        {
            "completed": result.completed,
            "fell": float(result.fell),
            "position_error_m": result.position_error,
            "yaw_error_deg": float(np.degrees(result.yaw_error)),
        },
    )


def push_check(newtons: float, scenario: Scenario, times: tuple[float, ...]) -> Outcome:
    """Pushes of 0.1 s from eight directions at each of ``times``."""
    fallen = []
    for direction in range(8):
        angle = direction * np.pi / 4.0
        force = newtons * np.array([np.cos(angle), np.sin(angle), 0.0])
        for at in times:
            if not push(scenario, force, at):
                fallen.append(f"{45 * direction}° at {at:.2f} s")
    total = 8 * len(times)
    return Outcome(
        not fallen,
        f"{total - len(fallen)}/{total} pushes survived" + (f"; fell: {fallen}" if fallen else ""),
        {"pushes": total, "falls": len(fallen)},
    )


def silence_check(scenario: Scenario, length: float, restart: bool) -> Outcome:
    """Silence or restart the controller while standing; no fall, no jump of the joint command."""
    result = silence(scenario, 2.0, length, restart=restart)
    return Outcome(
        not result.fell and result.joint_step < 0.05,
        f"{'FELL' if result.fell else 'no fall'}, guard {'held' if result.held else 'continued'}, "
        f"joint command step {result.joint_step:.4f} rad (< 0.05)",
        {"fell": float(result.fell), "joint_step_rad": result.joint_step},
    )


def midway_check(length: float, restart: bool, times: tuple[float, ...] = MOMENTS) -> Outcome:
    """Silence or restart the controller at several moments of a gait; the robot stays up."""
    scenario = Scenario(gaits=(Gait.FORWARD,))
    fell = [at for at in times if silence(scenario, at, length, restart=restart).fell]
    return Outcome(
        not fell,
        f"{len(times) - len(fell)}/{len(times)} moments survived"
        + (f"; fell: {fell}" if fell else ""),
        {"moments": len(times), "falls": len(fell)},
    )


def tracking_check(axis: int, gaits: tuple[Gait, ...], limit: float) -> Outcome:
    """Both hands follow 0.1 m at 0.5 Hz along one body axis."""
    hands = partial(SINE, axis=axis)
    mean, p99, fell = measures.tracking_error(
        Scenario(gaits=gaits, delay=0.01, hands=hands, tail=0.0), hands
    )
    return Outcome(
        not fell and mean <= limit,
        f"mean {1e3 * mean:.1f} mm (≤ {1e3 * limit:.0f}), p99 {1e3 * p99:.1f} mm",
        {"mean_m": mean, "p99_m": p99, "fell": float(fell)},
    )


def reach_check(target: tuple[float, float, float]) -> Outcome:
    """Static error two seconds after a reach: ≤ 5 mm and 2°."""
    position, rotation = measures.static_reach(np.array(target), Scenario(delay=0.01))
    return Outcome(
        position <= 0.005 and rotation <= np.radians(2.0),
        f"{1e3 * position:.1f} mm (≤ 5), {np.degrees(rotation):.2f}° (≤ 2)",
        {"position_m": position, "rotation_deg": float(np.degrees(rotation))},
    )


def determinism_check(count: int) -> Outcome:
    """Two runs with the same seed publish the same bytes; another seed does not."""
    scenario = Scenario(
        gaits=random_gaits(count, 3),
        delay=0.01,
        noise=NOISE,
        hands=measures.roaming_motion,
        seed=3,
    )
    first, second = measures.determinism(scenario)
    other = Stack(replace(scenario, seed=4), record=True)
    other.run_script()
    same, differs = first == second, other.runner.digest() != first
    return Outcome(
        same and differs,
        f"sha256 {first[:12]} {'=' if same else '≠'} {second[:12]}, other seed "
        f"{'differs' if differs else 'IS THE SAME'}",
        {"same": float(same), "other_differs": float(differs)},
    )


def all_checks(gaits: int, random: int) -> Iterator[Check]:
    """Every promise; ``gaits`` of each type in a row and ``random`` in one run set the length."""
    noisy = Scenario(delay=0.01, noise=NOISE)
    modes: list[tuple[str, Any]] = [("relaxed", noisy), ("rated", replace(noisy, mode="rated"))]
    for mode, scenario in modes:
        for gait in SIX:
            run = partial(gait_check, gait, gaits, scenario)
            yield Check(f"gaits, {mode}", f"{gaits} × {gait.name.lower()}", run)
    yield Check("random gaits", f"{random} with hands moving", partial(random_check, random, 7))
    standing, walking = Scenario(), Scenario(gaits=(Gait.FORWARD,))
    yield Check("pushes", "100 N standing", partial(push_check, 100.0, standing, (2.0,)))
    # Transfer, mid swing, transfer between the steps, second swing.
    times = (1.5, 2.3, 2.8, 3.3)
    yield Check("pushes", "60 N walking", partial(push_check, 60.0, walking, times))
    slow_loop = Scenario(gaits=SIX, delay=0.03)
    yield Check("loop delay", "30 ms, six gaits", partial(_six_check, slow_loop))
    for name, length, restart in (
        ("90 ms silent", 0.09, False),
        ("1 s silent", 1.0, False),
        ("restarted after 0.5 s", 0.5, True),
    ):
        run = partial(silence_check, standing, length, restart)
        yield Check("silence", f"{name}, standing", run)
        yield Check("silence", f"{name}, mid gait", partial(midway_check, length, restart))
    for axis, label in enumerate("xyz"):
        for state, sequence, limit in (
            ("standing", (), 0.010),
            ("walking", (Gait.FORWARD, Gait.SIDE_LEFT, Gait.TURN_RIGHT), 0.020),
        ):
            run = partial(tracking_check, axis, sequence, limit)
            yield Check("hand tracking", f"0.1 m, 0.5 Hz along {label}, {state}", run)
    for target in REACH_TARGETS:
        yield Check("static reach", f"to {target}", partial(reach_check, target))
    yield Check("determinism", "same seed, same bytes", partial(determinism_check, 3))


def _six_check(scenario: Scenario) -> Outcome:
    result = walk(scenario)
    return Outcome(
        not result.fell and result.completed == len(scenario.gaits),
        f"{result.completed}/{len(scenario.gaits)} gaits, {'FELL' if result.fell else 'no fall'}",
        {"completed": result.completed, "fell": float(result.fell)},
    )
