"""The synthetic operator as a service: it acts through the same mapping as a headset."""

import logging
from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from common.operator.claim import Claimant, own_replies
from common.runtime.service import Inputs, Output, Service
from common.schemas import (
    GaitReply,
    GuardMode,
    Header,
    OperatorKind,
    OperatorStatus,
    PlantState,
    Sender,
)
from common.tables import validated
from common.topics import (
    PLANT_STATE,
    TASK_SCENE,
    TELEOP_CLAIM,
    TELEOP_DEVICE,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    TELEOP_STATUS,
    WBC_AUTHORITY,
    WBC_REPLY,
    WBC_STATE,
    WBC_TARGET,
)
from services.teleop.errors import TeleopError
from services.teleop.headset.mapping import HeadsetMapper, MapperConfig
from services.teleop.synthetic.observation import Observation, Observer
from services.teleop.synthetic.operator_model import Act, OperatorModel, StrategyError
from services.teleop.synthetic.strategies import find_strategy
from services.teleop.synthetic.take_over import StallWatch, TakeOver
from services.teleop.synthetic.traits import TRAITS, OperatorTraits

log = logging.getLogger(__name__)

PERIOD_NS = 50_000_000
"""Device samples and set-points at 20 Hz."""
LONGEST_STEP = 0.1
STATUS_PERIOD = 0.2
FALLEN_HEIGHT = 0.5
"""Observed torso height below which the robot has fallen [m]."""
_STREAM = 0x5E17
"""Separates the operator's random numbers from those of the plant."""


class SyntheticConfig(BaseModel):
    """Configuration of the synthetic operator."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    task: str = Field(default="door/unlock", description="the plant's task")
    seed: int = Field(default=0, ge=0, description="of all random variation of the operator")
    traits: OperatorTraits = TRAITS["practised"]
    headset: MapperConfig = MapperConfig()
    start_timeout: float = Field(
        default=60.0, gt=0.0, description="timeout until BALANCE is seen and it has the robot [s]"
    )
    linger: float = Field(
        default=1.5, ge=0.0, description="time to go on holding after the task [s]"
    )
    stay: bool = Field(default=False, description="wait for the next trial instead of ending")
    take_over: TakeOver | None = Field(
        default=None,
        description="let another operator begin, and take the robot over from it when it does not "
        "get on; null: take the robot at once",
    )


class SyntheticOperator(Service):
    """Does one task and ends; after a reset of the plant it does it again with other variation.

    It acts while it has the robot. A person who takes the robot interrupts it; it goes on, from the
    controller's target, when it gets the robot back. An emergency stop ends its plan.

    It observes the robot (``plant/state``), the objects (``task/scene``) and the controller
    (``wbc/state``, ``wbc/reply``) through its inbox, hence with the delay of the feedback link. It
    acts through :class:`DeviceInput` and the same mapping as a person's headset.

    Attributes:
        failure: reason for which the plan failed; empty: it did not fail so far.
        model: model of the person; None until the robot is seen to balance.
    """

    name = "teleop"
    period_ns = PERIOD_NS
    reads = (PLANT_STATE, TASK_SCENE, WBC_STATE, WBC_REPLY, WBC_AUTHORITY, WBC_TARGET)
    writes = (TELEOP_CLAIM, TELEOP_DEVICE, TELEOP_SETPOINT, TELEOP_GAIT, TELEOP_STATUS)

    def __init__(self, config: SyntheticConfig | None = None) -> None:
        self.config = config or SyntheticConfig()
        self.settings = self.config.model_dump(mode="json")
        self._strategy = find_strategy(self.config.task)
        self._mapper = HeadsetMapper(self.config.headset)
        self._claimant = Claimant(OperatorKind.SCRIPT)
        self._last_ns: int | None = None
        self._shown: OperatorStatus | None = None
        self._since_shown = 0.0
        self._begin(0)

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Build the operator for a replay."""
        return cls(validated(SyntheticConfig, settings))

    def _begin(self, resets: int) -> None:
        self._resets = resets
        self._rng = np.random.default_rng((self.config.seed, resets, _STREAM))
        self._observer = Observer()
        self.model: OperatorModel | None = None
        self._plan: Act | None = None
        self._time = 0.0
        self._over_for: float | None = None
        self._acting = False
        self._watch: StallWatch | None = None
        if self.config.take_over is not None:
            # Also in a new trial another operator begins.
            self._claimant.release()
            self._watch = StallWatch(self.config.take_over)
        self.failure = ""

    @property
    def finished(self) -> bool:
        """Whether the plan has ended, successfully or not."""
        return self._over_for is not None

    @property
    def note(self) -> str:
        """What the operator is doing or waits for."""
        if self._watch is not None:
            return f"watching {self._claimant.holder or 'for somebody to begin'}"
        if not self._claimant.has_robot and not self.finished:
            return f"waiting: {self._claimant.waits_for()}"
        return "waiting" if self.model is None else self.model.note

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Observe, act for one tick, and report."""
        if self._last_ns is None:
            self._mapper.next_id = now_ns // 1_000_000
            self._last_ns = now_ns - self.period_ns
        elapsed = (now_ns - self._last_ns) * 1e-9
        self._last_ns = now_ns
        state = inputs.latest(PLANT_STATE)
        stopped = state is not None and state.guard is GuardMode.ESTOP
        self._claimant.update(inputs, Sender(self.name, self.boot), stopped=stopped)
        seen = self._observer.observe(state, inputs.latest(TASK_SCENE), inputs.latest(WBC_STATE))
        outputs = [] if seen is None else self._acts(seen, inputs, min(elapsed, LONGEST_STEP))
        header = Header() if seen is None else Header(stamp=seen.stamp)
        claims = self._claimant.claims(now_ns, header.stamp)
        # The status first: it says whether what follows is meant.
        return [*claims, *self._status(header, elapsed), *outputs]

    def _acts(self, seen: Observation, inputs: Inputs, dt: float) -> list[Output]:
        """Act for one tick of ``dt`` [s], if it has the robot; return what it sends to it."""
        if seen.resets != self._resets:
            self._begin(seen.resets)
            self._mapper = HeadsetMapper(self.config.headset, self._mapper.next_id)
        if self._watch is not None:
            if self._claimant.holder and self._watch.update(seen, dt):
                log.info("synthetic operator: takes over from %s", self._claimant.holder)
                self._watch = None
                self._claimant.ask(self._time)
            return []
        replies = own_replies(inputs.events(WBC_REPLY), self.boot)
        if self.model is not None and not self._claimant.has_robot:
            self._acting = False
            self._interrupted(seen, inputs.latest(PLANT_STATE), dt)
            return []
        self._time += dt
        self._act(seen, replies, dt)
        if self.model is None:
            return []
        target = inputs.latest(WBC_TARGET)
        if not self._acting and target is not None:
            self._mapper.adopt(target)
        self._acting = True
        device = self.model.device()
        requests = self._mapper.update(device, self._time)
        return [
            Output(TELEOP_DEVICE, device),
            Output(TELEOP_SETPOINT, self._mapper.setpoint(seen.stamp)),
            *(Output(TELEOP_GAIT, request) for request in requests),
        ]

    def _interrupted(self, seen: Observation, state: PlantState | None, dt: float) -> None:
        """Wait for the robot while the time of the plan stands still; give up after a stop."""
        if self._over_for is not None:
            self._linger(dt)
        elif state is not None and state.guard is GuardMode.ESTOP:
            self._give_up("the emergency stop is on")
        elif float(seen.torso.position[2]) < FALLEN_HEIGHT:
            self._give_up("the robot has fallen")

    def _act(self, seen: Observation, replies: Sequence[GaitReply], dt: float) -> None:
        if self.model is None:
            if seen.balancing and self._claimant.has_robot:
                self.model = OperatorModel(self.config.traits, self._rng, seen)
                self._plan = self._strategy(self.model)
            elif self._time > self.config.start_timeout:
                missing = self._claimant.waits_for() if seen.balancing else "no BALANCE seen"
                self.failure = f"not begun within {self.config.start_timeout:g} s: {missing}"
                self._leave(1)
            return
        model = self.model
        model.perceive(seen, replies, self._time, dt)
        if self._over_for is not None:
            self._linger(dt)
        elif self._plan is not None:
            self._continue(self._plan, seen)
        model.advance(dt)

    def _continue(self, plan: Act, seen: Observation) -> None:
        try:
            if float(seen.torso.position[2]) < FALLEN_HEIGHT:
                raise StrategyError("the robot has fallen")
            next(plan)
        except StopIteration:
            self._over_for = 0.0
            log.info("synthetic operator: %s: done", self.config.task)
        except TeleopError as error:
            self._give_up(str(error))

    def _give_up(self, reason: str) -> None:
        self.failure, self._over_for = reason, 0.0
        log.warning("synthetic operator: %s: gave up: %s", self.config.task, reason)

    def _linger(self, dt: float) -> None:
        """Hold the pose for a while after the task, then end unless it is to stay."""
        assert self._over_for is not None
        self._over_for += dt
        if self._over_for >= self.config.linger and not self.config.stay:
            self._leave(1 if self.failure else 0)

    def _leave(self, exit_code: int) -> None:
        """End, and give the robot back."""
        self._claimant.release()
        self.exit_code = exit_code

    def _status(self, header: Header, elapsed: float) -> list[Output]:
        """Return the status at 5 Hz and at every change."""
        status = OperatorStatus(
            script=f"synthetic {self.config.task}",
            step=int(self.finished),
            steps=1,
            label=self.note[:200],
            finished=self.finished,
            failed=self.failure[:200],
            slipping=self.model is not None and self.model.slipping,
        )
        self._since_shown += elapsed
        if status == self._shown and self._since_shown < STATUS_PERIOD:
            return []
        self._shown, self._since_shown = status, 0.0
        return [Output(TELEOP_STATUS, status.model_copy(update={"header": header}))]
