"""Strange senders: the robot keeps to its plant and its controller, and says so."""

from collections.abc import Sequence

import numpy as np

from common.plant.config import TorqueMode
from common.plant.fallback import HOLD_DAMPING, HOLD_STIFFNESS
from common.robot.joints import NOMINAL_POSITION
from common.runtime.service import Inputs, Output, Service
from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import (
    ControllerState,
    ControlState,
    Gait,
    GuardMode,
    Header,
    JointCommand,
    PlantStatus,
)
from common.topics import PLANT_STATE, PLANT_STATUS, WBC_COMMAND, WBC_STATE
from services.sim.config import TYPICAL_NOISE, SimConfig
from services.sim.service import PlantService
from services.wbc.config import WbcConfig
from services.wbc.service import WbcService
from verification.walking.stack import WalkingOperator

GAITS = (Gait.FORWARD,)


class Stranger(Service):
    """Sends a fresh joint command and a false plant state a thousand times a second."""

    name = "stranger"
    period_ns = 1_000_000
    reads = (PLANT_STATE,)
    writes = (WBC_COMMAND, PLANT_STATE)

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        state = inputs.latest(PLANT_STATE)
        if state is None or now_ns < 500_000_000:
            return []
        header = Header(stamp=state.header.stamp)
        command = JointCommand(
            header=header,
            position=NOMINAL_POSITION + 0.2,
            velocity=np.zeros(27),
            acceleration=np.zeros(27),
            torque=np.full(27, 20.0),
            stiffness=HOLD_STIFFNESS,
            damping=HOLD_DAMPING,
            gripper_closure=np.ones(2),
        )
        false = {"header": header, "base_linear_velocity": np.array([0.0, 2.0, 0.0])}
        return [
            Output(WBC_COMMAND, command),
            Output(PLANT_STATE, state.model_copy(update=false)),
        ]


def test_the_robot_walks_on_while_a_stranger_commands_and_reports_at_1_khz() -> None:
    plant = PlantService(SimConfig(noise=TYPICAL_NOISE))
    operator = WalkingOperator(GAITS, None)
    services = [plant, WbcService(WbcConfig()), operator, Stranger()]
    statuses: list[PlantStatus] = []
    with SimTimeRunner(services) as runner:
        runner.on_message(PLANT_STATUS, statuses.append)
        while not operator.done and runner.now_ns < 15e9:
            runner.run_for(0.1)
    assert not plant.plant.fallen
    assert operator.completed == len(GAITS)
    last = statuses[-1]
    assert last.holds == 0
    assert last.controller == "wbc"
    assert last.commands_foreign > 0.8 * 1000 * (1e-9 * runner.now_ns - 0.5)
    assert "stranger" in last.last_refusal
    assert "another controller" in last.last_refusal


def test_other_torque_limits_than_the_plants_move_nothing_and_are_told() -> None:
    plant = PlantService(SimConfig(torque_mode=TorqueMode.RATED))
    wbc = WbcService(WbcConfig())
    states: list[ControllerState] = []
    with SimTimeRunner([plant, wbc]) as runner:
        runner.on_message(WBC_STATE, states.append)
        runner.run_for(3.0)
    assert not plant.plant.fallen
    assert plant.plant.guard.mode is GuardMode.SILENT
    assert plant.plant.guard.refused == 0
    assert "--torque-mode" in states[-1].obstacle
    assert states[-1].state is not ControlState.BALANCE
