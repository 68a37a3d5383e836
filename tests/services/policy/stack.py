"""Plant, controller and a policy with made answers in simulated time, and what they said."""

from typing import Any

from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import (
    AuthorityState,
    Gait,
    GaitOutcome,
    GaitReply,
    PlantState,
    PolicyMode,
    PolicyState,
    Setpoint,
)
from common.topics import (
    PLANT_STATE,
    POLICY_STATE,
    TELEOP_SETPOINT,
    WBC_AUTHORITY,
    WBC_REPLY,
    WBC_TARGET,
    Topic,
)
from services.sim.config import SimConfig
from services.sim.service import PlantService
from services.wbc.config import wbc_config
from services.wbc.service import WbcService
from tests.services.policy.served import (
    MadePolicy,
    reaching,
)

MODE = PolicyMode
HEARD: tuple[Topic[Any], ...] = (
    PLANT_STATE,
    POLICY_STATE,
    TELEOP_SETPOINT,
    WBC_AUTHORITY,
    WBC_REPLY,
    WBC_TARGET,
)


class Stack:
    """Plant, controller and a policy on flat ground, and what was said."""

    def __init__(self, policy: MadePolicy, **links: str) -> None:
        self.policy, self.engine = policy, policy.made
        self.runner = SimTimeRunner(
            [PlantService(SimConfig(seed=3)), WbcService(wbc_config("relaxed", "fast")), policy],
            seed=3,
            links=links,
        )
        self.heard: dict[str, list[Any]] = {}
        for topic in HEARD:
            self.runner.on_message(topic, self.heard.setdefault(topic.name, []).append)

    def run(self, seconds: float) -> None:
        self.runner.run_for(seconds)

    @property
    def setpoints(self) -> list[Setpoint]:
        return self.heard[TELEOP_SETPOINT.name]

    @property
    def states(self) -> list[PolicyState]:
        return self.heard[POLICY_STATE.name]

    @property
    def authority(self) -> AuthorityState:
        said: list[AuthorityState] = self.heard[WBC_AUTHORITY.name]
        return said[-1]

    def mode(self) -> PolicyMode:
        return self.policy.mode

    @property
    def fallen(self) -> bool:
        states: list[PlantState] = self.heard[PLANT_STATE.name]
        return any(state.fallen for state in states)

    def completed(self) -> list[Gait]:
        replies: list[GaitReply] = self.heard[WBC_REPLY.name]
        return [reply.gait for reply in replies if reply.outcome is GaitOutcome.COMPLETED]

    def errors(self, last: int) -> list[float]:
        """How far the last set-points are from those made for their steps [m]."""
        steps = range(self.policy.steps - last, self.policy.steps)
        return [
            abs(setpoint.left_hand_position_in_body[0] - reaching(step)[0])
            for setpoint, step in zip(self.setpoints[-last:], steps, strict=True)
        ]


def modes(stack: Stack) -> list[PolicyMode]:
    """The modes in their order, each once."""
    said = [state.mode for state in stack.states]
    return [mode for i, mode in enumerate(said) if i == 0 or mode is not said[i - 1]]
