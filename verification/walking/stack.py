"""Plant, controller and a walking operator in one simulated-time runner."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from common.plant.config import TorqueMode
from common.robot import frames
from common.robot.rotations import wrap_angle, yaw_from_matrix
from common.runtime.service import Inputs, Output, Service
from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import (
    ControlState,
    Gait,
    GaitOutcome,
    GaitRequest,
    Header,
    OperatorClaim,
    OperatorKind,
    Setpoint,
)
from common.schemas.arrays import Float64Array as Array
from common.topics import TELEOP_CLAIM, TELEOP_GAIT, TELEOP_SETPOINT, WBC_REPLY, WBC_STATE
from services.sim.config import TYPICAL_NOISE, NoiseConfig, SimConfig
from services.sim.service import PlantService
from services.wbc.config import HandConfig, WbcConfig, wbc_config
from services.wbc.footsteps import Stance, gait_displacement
from services.wbc.service import WbcService

HandMotion = Callable[[float], tuple[Array, Array]]
"""Time [s] to (left, right) hand positions (3,) in the body frame [m]."""
FORWARD = np.array(frames.FORWARD_HAND_IN_BODY)
"""Orientation of a hand that points forward, (w, x, y, z) in the body frame."""
NOISE = TYPICAL_NOISE.model_copy(update={"joint_position": 0.0, "joint_velocity": 0.0})
"""State noise of the walking checks: 2 mm, 2 cm/s, 0.3°, 0.02 rad/s."""
SIDES = ("left", "right")
LONGEST_S = 1e4
"""A gait that is never answered ends a run here [s]."""


@dataclass(frozen=True)
class Scenario:
    """Conditions of one run.

    Attributes:
        gaits: gaits requested one after the other.
        torque_mode: torque limits of plant and controller.
        pace: pace of the gaits, see :func:`services.wbc.config.wbc_config`.
        delay: loop delay, half of it before and half after the controller [s].
        noise: white noise on the measured state.
        hands: motion of the hands; None publishes no set-points.
        hand_quaternions: (left, right) orientations (w, x, y, z) of the hands in the body frame.
        hand_mode: how the controller follows the set-points.
        solver: QP solver of the controller.
        seed: seed of everything random.
        tail: time run after the last gait, or in all if there are no gaits [s].
    """

    gaits: tuple[Gait, ...] = ()
    torque_mode: Literal["relaxed", "rated"] = "relaxed"
    pace: str = ""
    delay: float = 0.0
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    hands: HandMotion | None = None
    hand_quaternions: tuple[Array, Array] = (FORWARD, FORWARD)
    hand_mode: Literal["interpolate", "raw"] = "interpolate"
    solver: Literal["osqp", "daqp", "quadprog"] = "daqp"
    seed: int = 0
    tail: float = 1.0

    def wbc(self) -> WbcConfig:
        """Return the controller's configuration."""
        hands = HandConfig(mode=self.hand_mode)
        return wbc_config(self.torque_mode, self.pace, solver=self.solver, hands=hands)


class WalkingOperator(Service):
    """Request the next gait in the step that finds the robot balancing; move the hands at 20 Hz.

    Unlike the scripted operator it publishes no set-points without a hand motion, limits and
    retries nothing, and goes on after an aborted gait, so that the controller alone is measured. It
    is the only operator and claims to have the robot from the start, so that no controller waits.
    """

    name = "teleop"
    period_ns = 50_000_000
    reads = (WBC_STATE, WBC_REPLY)
    writes = (TELEOP_CLAIM, TELEOP_SETPOINT, TELEOP_GAIT)

    def __init__(
        self,
        gaits: Sequence[Gait],
        hands: HandMotion | None,
        quaternions: tuple[Array, Array] = (FORWARD, FORWARD),
    ) -> None:
        self._gaits = tuple(gaits)
        self._hands = hands
        self._quaternions = quaternions
        self._requested = 0
        self._waiting = False
        self.completed = 0

    @property
    def done(self) -> bool:
        """Whether every gait was requested and has ended."""
        return self._requested == len(self._gaits) and not self._waiting

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Read replies, request the next gait, publish the set-point."""
        for reply in inputs.events(WBC_REPLY):
            self.completed += reply.outcome is GaitOutcome.COMPLETED
            self._waiting = self._waiting and reply.outcome is GaitOutcome.ACCEPTED
        claim = OperatorClaim(kind=OperatorKind.SCRIPT, wants=True, act=1, holding=True)
        outputs = [Output(TELEOP_CLAIM, claim)]
        state = inputs.latest(WBC_STATE)
        balancing = state is not None and state.state is ControlState.BALANCE
        if balancing and not self._waiting and not self.done:
            gait = self._gaits[self._requested]
            outputs.append(Output(TELEOP_GAIT, GaitRequest(request_id=self._requested, gait=gait)))
            self._requested += 1
            self._waiting = True
        if self._hands is not None:
            left, right = self._hands(now_ns * 1e-9)
            setpoint = Setpoint(
                header=Header(stamp=now_ns),
                left_hand_position_in_body=left,
                left_hand_quaternion_in_body=self._quaternions[0],
                right_hand_position_in_body=right,
                right_hand_quaternion_in_body=self._quaternions[1],
                gripper_closure=np.zeros(2),
            )
            outputs.append(Output(TELEOP_SETPOINT, setpoint))
        return outputs


class Stack:
    """A running scenario; the check decides when to push the robot or stop a service."""

    def __init__(self, scenario: Scenario, *, record: bool = False) -> None:
        """Build the services; ``record`` keeps every message in the runner's log."""
        self.scenario = scenario
        self.plant_service = PlantService(
            SimConfig(
                torque_mode=TorqueMode(scenario.torque_mode),
                noise=scenario.noise,
                seed=scenario.seed,
            )
        )
        self.plant = self.plant_service.plant
        self.wbc_service = WbcService(scenario.wbc())
        self.operator = WalkingOperator(scenario.gaits, scenario.hands, scenario.hand_quaternions)
        half = f"{500.0 * scenario.delay:.6g}ms"
        self.runner = SimTimeRunner(
            [self.plant_service, self.wbc_service, self.operator],
            seed=scenario.seed,
            links={"wbc:plant/state": half, "sim:wbc/command": half} if scenario.delay else None,
            record=record,
        )

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self.runner.now_ns * 1e-9

    @property
    def fallen(self) -> bool:
        """Whether the robot has fallen."""
        return self.plant.fallen

    def run_for(self, seconds: float) -> None:
        """Run for a while, or until a fall."""
        end = self.time + seconds
        while self.time < end - 1e-9 and not self.fallen:
            self.runner.run_for(min(0.1, end - self.time))

    def run_script(self) -> None:
        """Run until every gait is over and the tail has passed, a fall, or :data:`LONGEST_S`."""
        while not (self.operator.done or self.fallen or self.time > LONGEST_S):
            self.runner.run_for(0.1)
        self.run_for(self.scenario.tail)

    def stance(self) -> Stance:
        """Return the true stance, midway between the soles."""
        left, right = (self.plant.data.site(frames.FOOT_FRAMES[side]) for side in SIDES)
        left_yaw, right_yaw = (yaw_from_matrix(foot.xmat.reshape(3, 3)) for foot in (left, right))
        yaw = right_yaw + 0.5 * wrap_angle(left_yaw - right_yaw)
        return Stance(0.5 * (left.xpos + right.xpos)[:2], yaw)

    def hand_in_body(self, side: int) -> Array:
        """Return the true position (3,) of a hand in the body frame [m]."""
        torso = self.plant.data.body(frames.BODY_FRAME)
        hand = self.plant.data.site(frames.HAND_FRAMES[SIDES[side]])
        inside: Array = torso.xmat.reshape(3, 3).T @ (hand.xpos - torso.xpos)
        return inside


def commanded_stance(start: Stance, gaits: Sequence[Gait], config: WbcConfig) -> Stance:
    """Return the stance in which a sequence of gaits should end."""
    stance = start
    for gait in gaits:
        stance = stance.moved(*gait_displacement(gait, config.gait))
    return stance
