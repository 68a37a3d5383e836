"""Commands and times for tests of the guard."""

from typing import Any

import numpy as np

from common.plant.guard import Guard
from common.robot.joints import JOINT_INDEX, NOMINAL_POSITION
from common.schemas import GuardMode, JointCommand
from tests.services.sim.support import MS

EPOCH = 1000 * MS
NOW = EPOCH + 10 * MS


def one_joint(name: str, value: float) -> Any:
    vector = np.zeros(27)
    vector[JOINT_INDEX[name]] = value
    return vector


def offer(guard: Guard, command: JointCommand, now_ns: int, measured: Any = None) -> bool:
    """Offer a command to a robot in the commanded posture, unless it is ``measured`` elsewhere."""
    return guard.offer(command, now_ns, NOMINAL_POSITION if measured is None else measured)


def mode(guard: Guard) -> GuardMode:
    return guard.mode
