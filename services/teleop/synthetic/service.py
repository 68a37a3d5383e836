"""The synthetic operator on the bus: sees and hears like a person, acts through the ingress."""

import logging
from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from common.errors import ConfigError, explain
from common.runtime.service import Inputs, Output, Service
from common.schemas import GaitReply, Header, OperatorStatus
from common.topics import (
    PLANT_STATE,
    TASK_SCENE,
    TELEOP_DEVICE,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    TELEOP_STATUS,
    WBC_REPLY,
    WBC_STATE,
)
from services.teleop.errors import TeleopError
from services.teleop.headset.mapping import HeadsetMapper, MapperConfig
from services.teleop.synthetic.person import Act, Person, StrategyError
from services.teleop.synthetic.sight import Eyes, Sight
from services.teleop.synthetic.strategies import find_strategy
from services.teleop.synthetic.traits import TRAITS, OperatorTraits

log = logging.getLogger(__name__)

PERIOD_NS = 50_000_000
"""Device samples and set-points at 20 Hz."""
LONGEST_STEP = 0.1
STATUS_PERIOD = 0.2
FALLEN_HEIGHT = 0.5
"""A torso seen lower than this has fallen [m]."""
_STREAM = 0x5E17
"""Sets the operator's random numbers apart from those of the plant."""


class SyntheticConfig(BaseModel):
    """Which task, which trial, which kind of operator."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    task: str = Field(default="door/unlock", description="as the plant was started with")
    seed: int = Field(default=0, ge=0, description="of everything that varies in the operator")
    traits: OperatorTraits = TRAITS["practised"]
    ingress: MapperConfig = MapperConfig()
    start_timeout: float = Field(default=60.0, gt=0.0, description="until BALANCE is seen [s]")
    linger: float = Field(default=1.5, ge=0.0, description="goes on holding after the task [s]")
    stay: bool = Field(default=False, description="then wait for the next trial, do not end")


class SyntheticOperator(Service):
    """Does one task, then ends; after a reset of the plant it starts anew, differently.

    It sees the robot (``plant/state``), the objects (``task/scene``) and what the controller says
    (``wbc/state``, ``wbc/reply``), all through its inbox and hence as late as the feedback link
    makes them. It acts through :class:`DeviceInput` and the same ingress as a person's headset.

    Attributes:
        failure: why its plan came to nothing; empty: it did not, or not yet.
        person: the operator; None until it sees the robot balance.
    """

    name = "teleop"
    period_ns = PERIOD_NS
    reads = (PLANT_STATE, TASK_SCENE, WBC_STATE, WBC_REPLY)
    writes = (TELEOP_DEVICE, TELEOP_SETPOINT, TELEOP_GAIT, TELEOP_STATUS)

    def __init__(self, config: SyntheticConfig | None = None) -> None:
        self.config = config or SyntheticConfig()
        self.settings = self.config.model_dump(mode="json")
        self._strategy = find_strategy(self.config.task)
        self._ingress = HeadsetMapper(self.config.ingress)
        self._last_ns: int | None = None
        self._shown: OperatorStatus | None = None
        self._since_shown = 0.0
        self._begin(0)

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Build an operator to be replayed."""
        try:
            return cls(SyntheticConfig.model_validate(settings))
        except ValidationError as error:
            raise ConfigError(f"the operator's settings are wrong: {explain(error)}") from error

    def _begin(self, resets: int) -> None:
        self._resets = resets
        self._rng = np.random.default_rng((self.config.seed, resets, _STREAM))
        self._eyes = Eyes()
        self.person: Person | None = None
        self._plan: Act | None = None
        self._time = 0.0
        self._over_for: float | None = None
        self.failure = ""

    @property
    def finished(self) -> bool:
        """Whether the plan has ended, well or not."""
        return self._over_for is not None

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """See, act for one tick, report."""
        if self._last_ns is None:
            self._ingress.next_id = now_ns // 1_000_000
            self._last_ns = now_ns - self.period_ns
        elapsed = (now_ns - self._last_ns) * 1e-9
        self._last_ns = now_ns
        dt = min(elapsed, LONGEST_STEP)
        replies = inputs.events(WBC_REPLY)
        sight = self._eyes.see(
            inputs.latest(PLANT_STATE), inputs.latest(TASK_SCENE), inputs.latest(WBC_STATE)
        )
        if sight is None:
            return self._status(Header(), elapsed)
        if sight.resets != self._resets:
            self._begin(sight.resets)
            self._ingress = HeadsetMapper(self.config.ingress, self._ingress.next_id)
        self._time += dt
        self._act(sight, replies, dt)
        header = Header(stamp=sight.stamp)
        if self.person is None:
            return self._status(header, elapsed)
        device = self.person.device()
        requests = self._ingress.take(device, self._time)
        return [
            Output(TELEOP_DEVICE, device),
            Output(TELEOP_SETPOINT, self._ingress.setpoint(sight.stamp)),
            *(Output(TELEOP_GAIT, request) for request in requests),
            *self._status(header, elapsed),
        ]

    def _act(self, sight: Sight, replies: Sequence[GaitReply], dt: float) -> None:
        if self.person is None:
            if sight.balancing:
                self.person = Person(self.config.traits, self._rng, sight)
                self._plan = self._strategy(self.person)
            elif self._time > self.config.start_timeout:
                self.failure = f"no BALANCE seen within {self.config.start_timeout:g} s"
                self.exit_code = 1
            return
        person = self.person
        person.perceive(sight, replies, self._time, dt)
        if self._over_for is not None:
            self._over_for += dt
            if self._over_for >= self.config.linger and not self.config.stay:
                self.exit_code = 1 if self.failure else 0
        elif self._plan is not None:
            self._go_on(self._plan, sight)
        person.advance(dt)

    def _go_on(self, plan: Act, sight: Sight) -> None:
        try:
            if float(sight.torso.position[2]) < FALLEN_HEIGHT:
                raise StrategyError("the robot has fallen")
            next(plan)
        except StopIteration:
            self._over_for = 0.0
            log.info("synthetic operator: %s: done", self.config.task)
        except TeleopError as error:
            self.failure = str(error)
            self._over_for = 0.0
            log.warning("synthetic operator: %s: gave up: %s", self.config.task, error)

    def _status(self, header: Header, elapsed: float) -> list[Output]:
        """The status, at 5 Hz and at every change."""
        status = OperatorStatus(
            script=f"synthetic {self.config.task}",
            step=int(self.finished),
            steps=1,
            label="waiting" if self.person is None else self.person.note[:200],
            finished=self.finished,
            failed=self.failure[:200],
        )
        self._since_shown += elapsed
        if status == self._shown and self._since_shown < STATUS_PERIOD:
            return []
        self._shown, self._since_shown = status, 0.0
        return [Output(TELEOP_STATUS, status.model_copy(update={"header": header}))]
