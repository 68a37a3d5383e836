"""Commands to offer, and the least of controllers."""

from typing import Any

import numpy as np

from common.plant.fallback import HOLD_DAMPING, HOLD_STIFFNESS
from common.plant.limits import STIFFNESS_MAX
from common.robot.joints import NOMINAL_POSITION
from common.schemas import Header, JointCommand, PlantState
from services.sim.physics.plant import Plant
from services.sim.physics.stance import standing_torque

MS = 1_000_000


def make_command(stamp_ns: int, **changes: Any) -> JointCommand:
    """A sound command at the nominal pose; ``changes`` are not validated, as on a bad day."""
    values: dict[str, Any] = {
        "header": Header(stamp=stamp_ns),
        "position": NOMINAL_POSITION.copy(),
        "velocity": np.zeros(27),
        "acceleration": np.zeros(27),
        "torque": np.zeros(27),
        "stiffness": np.full(27, 100.0),
        "damping": np.full(27, 2.0),
        "gripper_closure": np.zeros(2),
    }
    return JointCommand.model_construct(**(values | changes))


class Stander:
    """The least of controllers: holds the pose the plant had when it was made."""

    def __init__(self, plant: Plant) -> None:
        self._position = plant.truth().joint_position
        self._torque = standing_torque(plant.model, plant.addresses, np.array(plant.data.qpos))

    def command(self, state: PlantState) -> JointCommand:
        return make_command(
            state.header.stamp,
            position=self._position,
            torque=self._torque,
            stiffness=np.minimum(HOLD_STIFFNESS, STIFFNESS_MAX),
            damping=HOLD_DAMPING,
        )

    def run(self, plant: Plant, seconds: float) -> None:
        """Command the plant at 100 Hz, each command 5 ms after its state."""
        for i in range(round(seconds * 1000)):
            if i % 10 == 0:
                state = plant.measured()
            if i % 10 == 5:
                assert plant.offer(self.command(state))
            plant.step()


def run_silently(plant: Plant, seconds: float) -> None:
    """Let time pass without any command."""
    for _ in range(round(seconds * 1000)):
        plant.step()


def state_bytes(state: PlantState) -> bytes:
    """Everything in ``state``, to the last bit."""
    return repr(state.model_dump()).encode()
