"""Measurements of standing, walking and reaching: functions from a scenario to plain numbers."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from common.robot.joints import NUM_JOINTS
from common.robot.rotations import wrap_angle
from common.schemas import Gait, GuardMode
from common.schemas.arrays import Float64Array as Array
from common.topics import WBC_COMMAND
from services.wbc.service import WbcService
from verification.walking.stack import Scenario, Stack, commanded_stance

Numbers = dict[str, float | str]
"""Measured values by name; a text says what a number does not."""

BALANCE_TIME = 1.2
"""After this time the robot has stood up and balances [s]."""
REACH = (np.array([0.38, 0.27, 0.15]), np.array([0.38, -0.27, 0.15]))
"""(left, right) hand positions around which the hands move [m]."""


def walk(scenario: Scenario) -> Numbers:
    """Walk the scenario's gaits and compare the final stance with the commanded one."""
    stack = Stack(scenario)
    start = stack.stance()
    stack.run_script()
    end, goal = stack.stance(), commanded_stance(start, scenario.gaits, scenario.wbc())
    return {
        "completed": stack.operator.completed,
        "fell": float(stack.fallen),
        "position_error_m": float(np.linalg.norm(end.position - goal.position)),
        "yaw_error_deg": float(np.degrees(abs(wrap_angle(end.yaw - goal.yaw)))),
        "unsolved": stack.wbc_service.controller.unsolved,
        "saturated": stack.plant.saturated_fraction,
    }


def random_gaits(count: int, seed: int) -> tuple[Gait, ...]:
    """Return a seeded sequence of gaits of all six types."""
    rng = np.random.default_rng(seed)
    types = [gait for gait in Gait if gait is not Gait.NONE]
    return tuple(types[i] for i in rng.integers(0, len(types), count))


def sine_motion(time: float, axis: int) -> tuple[Array, Array]:
    """Move both hands in a sine of 0.1 m and 0.5 Hz about :data:`REACH` along a body axis."""
    offset = np.zeros(3)
    offset[axis] = 0.1 * np.sin(2.0 * np.pi * 0.5 * max(0.0, time - BALANCE_TIME - 1.0))
    return REACH[0] + offset, REACH[1] + offset


def roaming_motion(time: float) -> tuple[Array, Array]:
    """Move both hands on slow incommensurate sines, out of step."""

    def offset(shift: float) -> Array:
        waves = np.sin(2.0 * np.pi * np.array([0.23, 0.31, 0.19]) * time + shift)
        return np.array([0.06, 0.07, 0.10]) * waves

    return REACH[0] + offset(0.0), REACH[1] + offset(2.0)


def reach_motion(time: float, target: Array) -> tuple[Array, Array]:
    """Move the left hand to ``target`` (3,) in two seconds, the right one to its mirror image."""
    share = min(1.0, max(0.0, (time - BALANCE_TIME) / 2.0))
    left = REACH[0] + share * (target - REACH[0])
    return left, left * np.array([1.0, -1.0, 1.0])


def push(scenario: Scenario, force: Array, at: float) -> bool:
    """Push the torso for 0.1 s; return whether the robot still stands at the end.

    Args:
        scenario: conditions of the run.
        force: force in world (3,) [N].
        at: time of the push [s].
    """
    stack = Stack(scenario)
    stack.run_for(at)
    stack.plant.push(force, 0.1)
    stack.run_script()
    stack.run_for(2.0)
    return not stack.fallen


def pushes(scenario: Scenario, newtons: float, times: Sequence[float]) -> Numbers:
    """Push from eight directions at each of ``times``, one push a run."""
    fallen = []
    for direction in range(8):
        angle = direction * np.pi / 4.0
        force = newtons * np.array([np.cos(angle), np.sin(angle), 0.0])
        fallen += [
            f"{45 * direction}° at {at:.2f} s" for at in times if not push(scenario, force, at)
        ]
    return {"pushes": 8 * len(times), "falls": len(fallen), "fell_at": ", ".join(fallen)}


def silence(scenario: Scenario, at: float, length: float, restart: bool = False) -> Numbers:
    """Stop the controller for a while, or replace it by a new one then.

    Args:
        scenario: conditions of the run.
        at: time at which the controller stops [s].
        length: time for which it is silent [s].
        restart: a new controller takes its place.

    Returns:
        whether the robot fell, whether the guard went to HOLD, and the largest step of any joint
        command from the last before to the first after the silence [rad].
    """
    stack = Stack(scenario)
    commands: list[Array] = []
    stack.runner.on_message(WBC_COMMAND, lambda message: commands.append(message.position))
    stack.run_for(at)
    before = commands[-1] if commands else np.zeros(NUM_JOINTS)
    stack.runner.pause_service("wbc")
    stack.run_for(length)
    held = stack.plant.guard.mode is GuardMode.HOLD
    sent = len(commands)
    if restart:
        stack.runner.replace_service("wbc", WbcService(scenario.wbc()))
    stack.runner.resume_service("wbc")
    stack.run_for(0.1)
    first = commands[sent] if len(commands) > sent else before
    stack.run_for(5.0)
    step = float(np.abs(first - before).max())
    return {"fell": float(stack.fallen), "held": float(held), "joint_step_rad": step}


def silences(
    scenarios: Sequence[Scenario], moments: Sequence[float], length: float, restart: bool
) -> Numbers:
    """Stop the controller at each moment of each scenario's only gait, once a run.

    Args:
        scenarios: conditions of the runs.
        moments: shares of the gait's duration, which begins at :data:`BALANCE_TIME`.
        length: time for which the controller is silent [s].
        restart: a new controller takes its place.
    """
    fallen, held = [], 0.0
    for scenario in scenarios:
        for moment in moments:
            at = BALANCE_TIME + moment * scenario.wbc().gait.duration
            numbers = silence(scenario, at, length, restart)
            held += float(numbers["held"])
            if numbers["fell"]:
                fallen.append(f"{scenario.gaits[0].name} {at:.2f} s seed {scenario.seed}")
    runs = len(scenarios) * len(moments)
    return {"runs": runs, "held": held, "falls": len(fallen), "fell_at": ", ".join(fallen)}


def tracking(scenario: Scenario, axis: int) -> Numbers:
    """Measure the distance of the hands from a sine along one body axis.

    Sampled at 100 Hz from two seconds after the start, against the continuous motion from which
    the set-points were sampled, so that every delay counts.
    """
    hands = partial(sine_motion, axis=axis)
    stack = Stack(replace(scenario, hands=hands))
    stack.run_for(BALANCE_TIME + 2.0)
    errors: list[float] = []
    while not (stack.operator.done or stack.fallen) or len(errors) < 800:
        stack.run_for(0.01)
        if stack.fallen:
            break
        for side, target in enumerate(hands(stack.time)):
            errors.append(float(np.linalg.norm(stack.hand_in_body(side) - target)))
    return {
        "mean_m": float(np.mean(errors)),
        "p99_m": float(np.percentile(errors, 99.0)),
        "fell": float(stack.fallen),
    }


def static_reach(scenario: Scenario, target: tuple[float, float, float]) -> Numbers:
    """Measure the error of the worse hand two seconds after a slow reach."""
    hands = partial(reach_motion, target=np.array(target))
    stack = Stack(replace(scenario, hands=hands))
    stack.run_for(BALANCE_TIME + 4.0)
    controller = stack.wbc_service.controller
    _, report = controller.tick(stack.plant.truth(), stack.plant.now_ns * 1e-9)
    position, rotation = report.hand_error.max(axis=0)
    return {"position_m": float(position), "rotation_deg": float(np.degrees(rotation))}


def determinism(scenario: Scenario) -> Numbers:
    """Compare the SHA-256 of all published bytes of two runs, and of one with another seed."""
    digests = []
    for seed in (scenario.seed, scenario.seed, scenario.seed + 1):
        stack = Stack(replace(scenario, seed=seed), record=True)
        stack.run_script()
        digests.append(stack.runner.digest())
    first, second, other = digests
    same, differs = float(first == second), float(other != first)
    return {"same": same, "other_differs": differs, "sha256": first[:12]}
