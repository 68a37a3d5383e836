"""A person at a page, the plant and the controller, all but the person real, in simulated time."""

import numpy as np

from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import (
    AuthorityChange,
    AuthorityState,
    ControllerState,
    ControlState,
    PlantStatus,
    Setpoint,
)
from common.topics import PLANT_STATUS, TELEOP_SETPOINT, WBC_AUTHORITY, WBC_STATE, WBC_TARGET
from services.sim.config import SimConfig
from services.sim.service import PlantService
from services.teleop.headset.hub import Event
from services.teleop.headset.service import HeadsetOperator
from services.wbc.service import WbcService

from .people import grip, message, parse_dict

RATE = 50
"""Of the headset's samples [Hz]."""


class World:
    """The robot, and a headset worn by somebody."""

    def __init__(self) -> None:
        self.operator = HeadsetOperator()
        services = [PlantService(SimConfig(physics_steps=5)), WbcService(), self.operator]
        self.runner = SimTimeRunner(services)
        self.page = 1
        self.left, self.right = grip(-0.25, 1.2, -0.4), grip(0.25, 1.2, -0.4)
        self.states: list[ControllerState] = []
        self.changes: list[AuthorityState] = []
        self.statuses: list[PlantStatus] = []
        self.setpoints: list[Setpoint] = []
        self.targets: list[Setpoint] = []
        self.runner.on_message(WBC_STATE, self.states.append)
        self.runner.on_message(PLANT_STATUS, self.statuses.append)
        self.runner.on_message(TELEOP_SETPOINT, self.setpoints.append)
        self.runner.on_message(WBC_TARGET, self.targets.append)
        self.runner.on_message(WBC_AUTHORITY, self._note)

    def _note(self, state: AuthorityState) -> None:
        if not self.changes or self.changes[-1].changes != state.changes:
            self.changes.append(state)

    def wear(self, seconds: float) -> None:
        head = grip(0.0, 1.6, 0.0)
        for _ in range(round(seconds * RATE)):
            now_ns = self.runner.now_ns
            fields = {"head": head, "left": self.left, "right": self.right}
            sample = parse_dict(message("sample", 1e-6 * now_ns, **fields))
            self.operator.hub.put(Event(self.page, sample, now_ns))
            self.runner.run_for(1.0 / RATE)

    def reload(self) -> None:
        """The page goes in the middle of whatever it does, and is another one afterwards."""
        self.operator.hub.put(Event(self.page, None, self.runner.now_ns))
        self.page += 1

    def hand(self, targets: list[Setpoint]) -> np.ndarray:
        return np.array([target.left_hand_position_in_body for target in targets])


def test_a_reload_in_the_middle_of_a_gait_lets_it_end_and_the_robot_stand() -> None:
    world = World()
    world.runner.run_for(2.5)
    world.wear(0.1)
    before = world.hand(world.targets)[-1]
    world.left["squeeze"] = 1.0
    world.wear(0.4)
    assert [(c.holder, c.change) for c in world.changes[-1:]] == [
        ("headset", AuthorityChange.GRANTED)
    ]
    # A clutch that engages moves nothing; then the hand is 6 cm higher.
    assert np.abs(world.hand(world.setpoints) - before).max() < 1e-3
    world.left["position"] = [-0.25, 1.26, -0.4]
    world.wear(0.4)
    np.testing.assert_allclose(world.hand(world.targets)[-1] - before, [0, 0, 0.06], atol=2e-3)

    world.right["upper"] = False
    world.left["upper"] = True
    world.wear(1.0)
    assert world.states[-1].gait.name == "FORWARD"
    assert world.states[-1].state is not ControlState.BALANCE
    held = world.hand(world.targets)[-1]
    sent = len(world.setpoints)
    world.reload()
    world.left = grip(0.0, 0.8, -0.1, squeeze=1.0, upper=True)
    world.wear(4.0)
    assert len(world.setpoints) == sent
    assert (world.changes[-1].holder, world.changes[-1].change) == ("", AuthorityChange.EXPIRED)
    assert (world.states[-1].state, world.states[-1].gaits_completed) == (ControlState.BALANCE, 1)
    assert not world.statuses[-1].fallen
    assert np.abs(world.hand(world.targets)[-1] - held).max() < 1e-3

    # The same person lets the clutch go and takes it anew, without a jump.
    world.left = grip(0.0, 0.8, -0.1)
    world.wear(0.1)
    world.left["squeeze"] = 1.0
    world.wear(0.5)
    assert world.changes[-1].holder == "headset"
    assert np.abs(world.hand(world.setpoints)[sent:] - held).max() < 1e-3
    assert not world.statuses[-1].fallen
