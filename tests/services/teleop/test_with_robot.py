"""A person at the keyboard and a script on one robot, all of them real, in simulated time."""

import numpy as np

from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import AuthorityChange as Change
from common.schemas import AuthorityState, PlantStatus, Setpoint
from common.topics import PLANT_STATUS, WBC_AUTHORITY, WBC_TARGET
from services.sim.config import SimConfig
from services.sim.service import PlantService
from services.teleop.keyboard.service import KeyboardOperator
from services.teleop.scripted.library import ScriptOptions, script_named
from services.teleop.scripted.service import ScriptedOperator
from services.wbc.service import WbcService

from .desk import FakeScreen


class Robot:
    """Plant, controller, script and keyboard; every second stop is lost on its way."""

    def __init__(self) -> None:
        self.screen = FakeScreen()
        self.script = ScriptedOperator(script_named("stand", ScriptOptions(seconds=30.0)))
        services = [
            PlantService(SimConfig(physics_steps=5)),
            WbcService(),
            self.script,
            KeyboardOperator(self.screen),
        ]
        self.runner = SimTimeRunner(services, links={"estop": "0ms loss=50% seed=1"})
        self.statuses: list[PlantStatus] = []
        self.changes: list[AuthorityState] = []
        self.targets: list[Setpoint] = []
        self.runner.on_message(PLANT_STATUS, self.statuses.append)
        self.runner.on_message(WBC_AUTHORITY, self._note)
        self.runner.on_message(WBC_TARGET, self.targets.append)

    def _note(self, state: AuthorityState) -> None:
        if not self.changes or self.changes[-1].changes != state.changes:
            self.changes.append(state)

    def type(self, *keys: str, run: float = 0.5) -> None:
        self.screen.typed += [key.encode() for key in keys]
        self.runner.run_for(run)

    @property
    def guard(self) -> str:
        return self.statuses[-1].guard.name

    @property
    def why(self) -> tuple[str, Change]:
        return self.changes[-1].holder, self.changes[-1].change


def test_a_person_takes_gives_stops_and_only_the_clear_key_and_a_new_act_go_on() -> None:
    robot = Robot()
    robot.runner.run_for(3.0)
    assert robot.why == ("teleop", Change.GRANTED)
    robot.type("\r")
    assert robot.why == ("keyboard", Change.TAKEN)
    assert "YOU have it: taken from teleop" in robot.screen.text
    robot.type("3", *"ikuo" * 2, run=1.0)
    robot.type("\r")
    assert [(c.holder, c.change) for c in robot.changes[-2:]] == [
        ("", Change.RELEASED),
        ("teleop", Change.GRANTED),
    ]
    hands = np.array([t.left_hand_position_in_body for t in robot.targets])
    assert np.linalg.norm(np.diff(hands, axis=0), axis=1).max() < 0.4 * 0.05

    robot.type("\u0447", run=0.06)
    assert robot.guard == "ESTOP"
    assert robot.statuses[-1].stopped_by == "keyboard"
    robot.type("r", "r", "\r", "w", run=0.5)
    assert robot.guard == "ESTOP"
    assert robot.why == ("", Change.STOPPED)
    assert "emergency stop is on" in robot.script.failure

    robot.type("b", "b", "r", "r", run=3.0)
    assert robot.guard == "ACTIVE"
    assert robot.why == ("", Change.STOPPED)
    robot.type("i")
    assert robot.why == ("keyboard", Change.GRANTED)
    assert not robot.statuses[-1].fallen
