"""Plant, controller and a scripted study operator in one simulated-time runner."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from common.plant.config import TorqueMode
from common.robot import frames
from common.robot.rotations import wrap_angle, yaw_from_matrix
from common.runtime.service import Inputs, Output, Service
from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import ControlState, Gait, GaitOutcome, GaitRequest, Header, Setpoint
from common.schemas.arrays import Float64Array as Array
from common.topics import TELEOP_GAIT, TELEOP_SETPOINT, WBC_REPLY, WBC_STATE
from services.sim.config import TYPICAL_NOISE, NoiseConfig, SimConfig
from services.sim.service import PlantService
from services.wbc.config import WbcConfig, wbc_config
from services.wbc.footsteps import Stance, gait_displacement
from services.wbc.service import WbcService

HandMotion = Callable[[float], tuple[Array, Array]]
"""Time [s] to (left, right) hand positions (3,) in the body frame [m]."""
FORWARD = np.array(frames.FORWARD_HAND_IN_BODY)
"""Orientation of a hand that points forward, (w, x, y, z) in the body frame."""


@dataclass(frozen=True)
class Scenario:
    """One run.

    Attributes:
        gaits: requested one after the other.
        mode: torque limits of plant and controller.
        pace: as in :func:`services.wbc.config.wbc_config`.
        delay: loop delay, half of it before and half after the controller [s].
        noise: white noise on the measured state.
        hands: motion of the hands, or None to leave them where they are.
        solver: of the QP.
        seed: of everything random.
        tail: time run after the last gait, or in all if there are no gaits [s].
    """

    gaits: tuple[Gait, ...] = ()
    mode: Literal["relaxed", "rated"] = "relaxed"
    pace: str = ""
    delay: float = 0.0
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    hands: HandMotion | None = None
    solver: Literal["osqp", "daqp", "quadprog"] = "osqp"
    seed: int = 0
    tail: float = 1.0

    def wbc(self) -> WbcConfig:
        """The controller's configuration."""
        return wbc_config(self.mode, self.pace, solver=self.solver)


NOISE = TYPICAL_NOISE.model_copy(update={"joint_position": 0.0, "joint_velocity": 0.0})
"""State noise of the walking suites: 2 mm, 2 cm/s, 0.3°, 0.02 rad/s."""


class StudyOperator(Service):
    """Asks for the next gait whenever the robot balances, and moves the hands at 20 Hz."""

    name = "teleop"
    period_ns = 50_000_000
    reads = (WBC_STATE, WBC_REPLY)
    writes = (TELEOP_SETPOINT, TELEOP_GAIT)

    def __init__(self, gaits: Sequence[Gait], hands: HandMotion | None) -> None:
        self._gaits = list(gaits)
        self._hands = hands
        self._asked = 0
        self._waiting = False
        self.completed = 0
        self.refused: list[str] = []

    @property
    def done(self) -> bool:
        """Every gait was asked for and is over."""
        return self._asked == len(self._gaits) and not self._waiting

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Take replies, ask for the next gait, publish the set-point."""
        for reply in inputs.events(WBC_REPLY):
            if reply.outcome is GaitOutcome.COMPLETED:
                self.completed += 1
            if reply.outcome is GaitOutcome.REFUSED:
                self.refused.append(reply.reason)
            self._waiting = self._waiting and reply.outcome is GaitOutcome.ACCEPTED
        outputs: list[Output] = []
        state = inputs.latest(WBC_STATE)
        ready = state is not None and state.state is ControlState.BALANCE
        if ready and not self._waiting and self._asked < len(self._gaits):
            gait = self._gaits[self._asked]
            outputs.append(Output(TELEOP_GAIT, GaitRequest(request_id=self._asked, gait=gait)))
            self._asked += 1
            self._waiting = True
        if self._hands is not None:
            outputs.append(Output(TELEOP_SETPOINT, self._setpoint(self._hands, now_ns)))
        return outputs

    @staticmethod
    def _setpoint(hands: HandMotion, now_ns: int) -> Setpoint:
        left, right = hands(now_ns * 1e-9)
        return Setpoint(
            header=Header(stamp=now_ns),
            left_hand_position_in_body=left,
            left_hand_quaternion_in_body=FORWARD,
            right_hand_position_in_body=right,
            right_hand_quaternion_in_body=FORWARD,
            gripper_closure=np.zeros(2),
        )


class Stack:
    """A running scenario; the study decides when to push, silence or replace what."""

    def __init__(self, scenario: Scenario, *, record: bool = False) -> None:
        self.scenario = scenario
        mode = TorqueMode(scenario.mode)
        self.plant_service = PlantService(
            SimConfig(torque_mode=mode, noise=scenario.noise, seed=scenario.seed)
        )
        self.plant = self.plant_service.plant
        self.wbc_service = WbcService(scenario.wbc())
        self.operator = StudyOperator(scenario.gaits, scenario.hands)
        half = f"{500.0 * scenario.delay:.6g}ms"
        links = {"wbc:plant/state": half, "sim:wbc/command": half} if scenario.delay else None
        self.runner = SimTimeRunner(
            [self.plant_service, self.wbc_service, self.operator],
            seed=scenario.seed,
            links=links,
            record=record,
        )

    @property
    def time(self) -> float:
        """Virtual time [s]."""
        return self.runner.now_ns * 1e-9

    @property
    def fallen(self) -> bool:
        """Whether the robot is down."""
        return self.plant.fallen

    def run_for(self, seconds: float) -> None:
        """Run, or stop early at a fall."""
        end = self.time + seconds
        while self.time < end - 1e-9 and not self.fallen:
            self.runner.run_for(min(0.1, end - self.time))

    def run_script(self, limit: float = 1e4) -> None:
        """Run until every gait is over and the tail has passed, a fall, or the limit [s]."""
        while not (self.operator.done or self.fallen or self.time > limit):
            self.runner.run_for(0.1)
        self.run_for(self.scenario.tail)

    def site(self, name: str) -> tuple[Array, Array]:
        """True position (3,) and rotation (3, 3) of an MJCF site in world."""
        site = self.plant.data.site(name)
        return np.array(site.xpos), np.array(site.xmat).reshape(3, 3)

    def stance(self) -> Stance:
        """True stance: midway between the soles."""
        (left, left_r), (right, right_r) = (self.site(frames.FOOT_FRAMES[s]) for s in _SIDES)
        yaw = yaw_from_matrix(right_r) + 0.5 * wrap_angle(
            yaw_from_matrix(left_r) - yaw_from_matrix(right_r)
        )
        return Stance(0.5 * (left + right)[:2], yaw)

    def hand_in_body(self, side: int) -> Array:
        """True position (3,) of a hand in the body frame."""
        torso = self.plant.data.body(frames.BODY_FRAME)
        position, _ = self.site(frames.HAND_FRAMES[_SIDES[side]])
        inside: Array = torso.xmat.reshape(3, 3).T @ (position - torso.xpos)
        return inside


_SIDES = ("left", "right")


def commanded_stance(start: Stance, gaits: Sequence[Gait], config: WbcConfig) -> Stance:
    """Where a sequence of gaits should end."""
    stance = start
    for gait in gaits:
        stance = stance.moved(*gait_displacement(gait, config.gait))
    return stance


def commanded_travel(gaits: Sequence[Gait], config: WbcConfig) -> tuple[float, float]:
    """Distance [m] and angle [rad] a sequence of gaits covers, summed without sign."""
    moves = [gait_displacement(gait, config.gait) for gait in gaits]
    distance = sum(float(np.hypot(forward, left)) for forward, left, _ in moves)
    return distance, sum(abs(turn) for _, _, turn in moves)
