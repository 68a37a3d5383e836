"""What several files share: the model, and a walk recorded once."""

import pytest

from common.plant.config import TorqueMode
from common.schemas import Gait
from services.sim.config import TYPICAL_NOISE, SimConfig
from services.wbc.config import WbcConfig, wbc_config
from services.wbc.robot_model import RobotModel

from .bench import Tick, record


@pytest.fixture(scope="session")
def model() -> RobotModel:
    return RobotModel()


@pytest.fixture(scope="session")
def walk() -> list[Tick]:
    """Every second tick of standing up and a step forward, OSQP in the loop, typical noise."""
    config, sim = WbcConfig(stand_time=0.4), SimConfig(noise=TYPICAL_NOISE)
    return record(config, sim, stride=2, gaits=[Gait.FORWARD])


@pytest.fixture(scope="session")
def rated_walk() -> list[Tick]:
    """Every second tick of standing up and a step aside with rated torques, without noise."""
    sim = SimConfig(torque_mode=TorqueMode.RATED)
    return record(wbc_config("rated", stand_time=0.4), sim, stride=2, gaits=[Gait.SIDE_RIGHT])
