"""The walking study's measurements: each a function from a scenario to plain numbers."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from common.robot.joints import NUM_JOINTS
from common.robot.rotations import wrap_angle
from common.schemas import Gait, GuardMode
from common.schemas.arrays import Float64Array as Array
from common.topics import WBC_COMMAND
from services.wbc.service import WbcService
from verification.walking.stack import (
    HandMotion,
    Scenario,
    Stack,
    commanded_stance,
    commanded_travel,
)

BALANCE_TIME = 1.2
"""After this the robot has stood up and balances [s]."""
REACH = (np.array([0.38, 0.27, 0.15]), np.array([0.38, -0.27, 0.15]))
"""(left, right) hand positions around which the hands move [m]."""


@dataclass(frozen=True)
class WalkResult:
    """Outcome of a sequence of gaits.

    Attributes:
        fell: whether the robot fell.
        completed: gaits completed.
        position_error: final stance against the commanded one [m].
        yaw_error: likewise [rad].
        distance: commanded, summed [m].
        turn: commanded, summed [rad].
        unsolved: ticks whose QP was not solved.
        saturated: share of physics steps with a motor at its limit.
        time: simulated [s].
    """

    fell: bool
    completed: int
    position_error: float
    yaw_error: float
    distance: float
    turn: float
    unsolved: int
    saturated: float
    time: float

    @property
    def position_allowance(self) -> float:
        """2 cm per 2 m commanded, but at least 2 cm [m]."""
        return 0.02 * max(1.0, self.distance / 2.0)

    @property
    def yaw_allowance(self) -> float:
        """2 degrees per 180 commanded, but at least 2 degrees [rad]."""
        return float(np.radians(2.0)) * max(1.0, self.turn / np.pi)

    @property
    def within_tolerance(self) -> bool:
        """Stood to the end, and close enough to where it should be."""
        return (
            not self.fell
            and self.position_error <= self.position_allowance
            and self.yaw_error <= self.yaw_allowance
        )


def walk(scenario: Scenario) -> WalkResult:
    """Walk the scenario's gaits and compare the final stance with the commanded one."""
    stack = Stack(scenario)
    start = stack.stance()
    stack.run_script()
    end, config = stack.stance(), scenario.wbc()
    goal = commanded_stance(start, scenario.gaits, config)
    distance, turn = commanded_travel(scenario.gaits, config)
    return WalkResult(
        fell=stack.fallen,
        completed=stack.operator.completed,
        position_error=float(np.linalg.norm(end.position - goal.position)),
        yaw_error=abs(wrap_angle(end.yaw - goal.yaw)),
        distance=distance,
        turn=turn,
        unsolved=stack.wbc_service.controller.unsolved,
        saturated=stack.plant.saturated_fraction,
        time=stack.time,
    )


def random_gaits(count: int, seed: int) -> tuple[Gait, ...]:
    """Seeded sequence of gaits of all six types."""
    rng = np.random.default_rng(seed)
    types = [gait for gait in Gait if gait is not Gait.NONE]
    return tuple(types[i] for i in rng.integers(0, len(types), count))


def sine_motion(time: float, amplitude: float, frequency: float, axis: int) -> tuple[Array, Array]:
    """Both hands in a sine about :data:`REACH`, still until :data:`BALANCE_TIME`."""
    phase = 2.0 * np.pi * frequency * max(0.0, time - BALANCE_TIME - 1.0)
    offset = np.zeros(3)
    offset[axis] = amplitude * np.sin(phase)
    return REACH[0] + offset, REACH[1] + offset


def roaming_motion(time: float) -> tuple[Array, Array]:
    """Both hands wander on slow incommensurate sines, out of step."""

    def offset(shift: float) -> Array:
        waves = np.sin(2.0 * np.pi * np.array([0.23, 0.31, 0.19]) * time + shift)
        return np.array([0.06, 0.07, 0.10]) * waves

    return REACH[0] + offset(0.0), REACH[1] + offset(2.0)


def push(scenario: Scenario, force: Array, at: float, *, duration: float = 0.1) -> bool:
    """Push the torso ``at`` seconds into the run; whether the robot still stands at the end."""
    stack = Stack(scenario)
    stack.run_for(at)
    stack.plant.push(force, duration)
    stack.run_script()
    stack.run_for(2.0)
    return not stack.fallen


def tracking_error(scenario: Scenario, hands: HandMotion) -> tuple[float, float, bool]:
    """Mean and p99 distance [m] of the hands from where they should be now, and whether it fell.

    Sampled at 100 Hz from two seconds after the start, against the continuous motion the
    set-points were sampled from, so that every delay counts.
    """
    stack = Stack(scenario)
    stack.run_for(BALANCE_TIME + 2.0)
    errors: list[float] = []
    while not (stack.operator.done or stack.fallen) or len(errors) < 800:
        stack.run_for(0.01)
        if stack.fallen:
            break
        targets = hands(stack.time)
        for side in (0, 1):
            errors.append(float(np.linalg.norm(stack.hand_in_body(side) - targets[side])))
    return float(np.mean(errors)), float(np.percentile(errors, 99.0)), stack.fallen


def static_reach(target: Array, scenario: Scenario) -> tuple[float, float]:
    """Position [m] and rotation [rad] error of the worse hand two seconds after a slow reach."""

    def motion(time: float) -> tuple[Array, Array]:
        share = min(1.0, max(0.0, (time - BALANCE_TIME) / 2.0))
        left = REACH[0] + share * (target - REACH[0])
        return left, left * np.array([1.0, -1.0, 1.0])

    stack = Stack(Scenario(**{**vars(scenario), "hands": motion}))
    stack.run_for(BALANCE_TIME + 4.0)
    controller = stack.wbc_service.controller
    _, report = controller.tick(stack.plant.truth(), stack.plant.now_ns * 1e-9)
    return float(report.hand_error[:, 0].max()), float(report.hand_error[:, 1].max())


@dataclass(frozen=True)
class SilenceResult:
    """Outcome of silencing the controller for a while."""

    fell: bool
    held: bool
    joint_step: float


def silence(
    scenario: Scenario, at: float, length: float, *, restart: bool = False
) -> SilenceResult:
    """Silence the controller from ``at`` for ``length`` seconds, or replace it then.

    Returns:
        whether the robot fell, whether the guard went to HOLD, and the largest step [rad] of any
        joint command from the last before to the first after the silence.
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
    return SilenceResult(stack.fallen, held, float(np.abs(first - before).max()))


def determinism(scenario: Scenario) -> tuple[str, str]:
    """SHA-256 over every byte published in two runs of the same scenario."""
    digests = []
    for _ in range(2):
        stack = Stack(scenario, record=True)
        stack.run_script()
        digests.append(stack.runner.digest())
    return digests[0], digests[1]


SINE = partial(sine_motion, amplitude=0.1, frequency=0.5)
"""The hand-tracking motion: 0.1 m, 0.5 Hz."""
