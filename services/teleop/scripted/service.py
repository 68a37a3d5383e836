"""The scripted operator as a service: plays a script, then ends its process."""

import logging
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field

from common.operator.claim import Claimant, own_replies
from common.runtime.service import Inputs, Output, Service
from common.schemas import (
    ControllerState,
    ControlState,
    Gait,
    GaitReply,
    GuardMode,
    Header,
    OperatorKind,
    OperatorStatus,
    PlantStatus,
    Sender,
)
from common.tables import validated
from common.topics import (
    PLANT_STATUS,
    TELEOP_CLAIM,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    TELEOP_STATUS,
    WBC_AUTHORITY,
    WBC_REPLY,
    WBC_STATE,
    WBC_TARGET,
)
from services.teleop.errors import ScriptError
from services.teleop.scripted.gaits import GaitClient, GaitPatience
from services.teleop.scripted.player import ScriptContext, play
from services.teleop.scripted.script import Script
from services.teleop.targets.hand import MotionLimits
from services.teleop.targets.targets import OperatorTargets

log = logging.getLogger(__name__)

PERIOD_NS = 50_000_000
"""Set-points at 20 Hz."""
LONGEST_STEP = 0.1
"""Largest time by which one step moves the targets [s]."""
STATUS_PERIOD = 0.2
LABEL_WAITING = "waiting for the controller to balance"
REMEDY = "end a stop with `trill resume`, stand the robot up with `trill reset`"


class ScriptedConfig(BaseModel):
    """Configuration of the scripted operator."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    limits: MotionLimits = MotionLimits()
    patience: GaitPatience = GaitPatience()
    start_timeout: float = Field(
        default=60.0, gt=0.0, description="timeout until BALANCE and until it has the robot [s]"
    )
    trouble_timeout: float = Field(
        default=5.0,
        gt=0.0,
        description="time for which it waits at its start for a fallen or stopped robot [s]",
    )
    silence_timeout: float = Field(
        default=3.0, gt=0.0, description="time without a controller state after which it fails [s]"
    )
    linger: float = Field(
        default=1.0, ge=0.0, description="time to go on with set-points after the script [s]"
    )


class ScriptedOperator(Service):
    """Publishes set-points at 20 Hz, and the script's gait requests once the robot balances.

    It does so while it has the robot, from the controller's target on. A person who takes the
    robot pauses the script, which goes on when it gets the robot back; a fall or an emergency stop
    ends it. After the script it goes on for ``linger`` seconds, gives the robot back and sets
    ``exit_code``: 0, or 1 when the script failed, with the reason in :attr:`failure`. The script's
    clock stops while the plant is paused. Request ids start at the runner's clock in milliseconds,
    so that they are greater than those of an earlier operator.
    """

    name = "teleop"
    period_ns = PERIOD_NS
    reads = (WBC_STATE, WBC_REPLY, WBC_AUTHORITY, WBC_TARGET, PLANT_STATUS)
    writes = (TELEOP_CLAIM, TELEOP_SETPOINT, TELEOP_GAIT, TELEOP_STATUS)

    def __init__(self, script: Script, config: ScriptedConfig | None = None) -> None:
        """Prepare to play ``script``."""
        self.script = script
        self.config = config or ScriptedConfig()
        self.settings = {
            "script": script.model_dump(mode="json"),
            "config": self.config.model_dump(mode="json"),
        }
        self.failure = ""
        self.targets = OperatorTargets(self.config.limits)
        self._claimant = Claimant(OperatorKind.SCRIPT)
        self._began = False
        self._replies: list[GaitReply] = []
        self._context = ScriptContext(self.targets, GaitClient(self.config.patience))
        self._program: Iterator[None] | None = None
        self._steps_done = 0
        self._waited = self._troubled = 0.0
        self._waiting_for = LABEL_WAITING
        self._ended_for: float | None = None
        self._last_ns: int | None = None
        self._shown: OperatorStatus | None = None
        self._since_shown = 0.0

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Build the operator for a replay."""
        return cls(
            validated(Script, settings.get("script", {})),
            validated(ScriptedConfig, settings.get("config", {})),
        )

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Advance the script by one tick; see :class:`common.runtime.service.Service`."""
        if self._last_ns is None:
            self._context.gaits.next_id = now_ns // 1_000_000
            self._last_ns = now_ns - self.period_ns
        elapsed = (now_ns - self._last_ns) * 1e-9
        self._last_ns = now_ns

        plant = inputs.latest(PLANT_STATUS) if inputs.fresh(PLANT_STATUS) else None
        paused = plant is not None and plant.paused
        controller = inputs.latest(WBC_STATE)
        stamp = 0 if controller is None else controller.header.stamp
        fresh = controller if inputs.fresh(WBC_STATE) else None
        has_robot = self._claim(inputs, plant)
        context = self._context
        context.dt = min(elapsed, LONGEST_STEP) if has_robot and not paused else 0.0
        self._replies += own_replies(inputs.events(WBC_REPLY), self.boot)
        if has_robot:
            # Replies and timeouts run on real time, however late this step is.
            context.gaits.update(0.0 if paused else elapsed, self._replies, fresh)
            self._replies = []
        try:
            self._act(inputs, fresh, plant, elapsed)
        except ScriptError as error:
            self._fail(str(error))
        self.targets.advance(context.dt)

        header = Header(stamp=stamp)
        outputs = self._claimant.claims(now_ns, stamp)
        if has_robot:
            outputs.append(Output(TELEOP_SETPOINT, self.targets.setpoint(stamp)))
        requests, context.gaits.outbox = context.gaits.outbox, []
        outputs += [
            Output(TELEOP_GAIT, request.model_copy(update={"header": header}))
            for request in requests
        ]
        return outputs + self._status(header, elapsed)

    def _claim(self, inputs: Inputs, plant: PlantStatus | None) -> bool:
        """Return whether it has the robot; until it first has, follow the controller's target."""
        stopped = plant is not None and plant.guard is GuardMode.ESTOP
        self._claimant.update(inputs, Sender(self.name, self.boot), stopped=stopped)
        target = inputs.latest(WBC_TARGET)
        if not self._began and target is not None:
            self.targets.adopt(target)
        self._began = self._began or self._claimant.has_robot
        return self._claimant.has_robot

    def _act(
        self,
        inputs: Inputs,
        controller: ControllerState | None,
        plant: PlantStatus | None,
        elapsed: float,
    ) -> None:
        """Wait for the start, play, or end.

        Raises:
            ScriptError: the script cannot continue.
        """
        if self._ended_for is not None:
            self._ended_for += elapsed
            if self._ended_for >= self.config.linger:
                self._claimant.release()
                self.exit_code = 1 if self.failure else 0
        elif self._program is None:
            self._wait_for_start(controller, plant, elapsed)
        else:
            if trouble := _trouble(plant):
                raise ScriptError(trouble)
            silent = inputs.age(WBC_STATE)
            paused = plant is not None and plant.paused
            if silent > self.config.silence_timeout and not paused:
                raise ScriptError(f"the controller has been silent for {silent:.1f} s")
            if not self._claimant.has_robot:
                return
            if next(self._program, _DONE) is _DONE:
                self._ended_for = 0.0
                log.info("script %s: finished", self.script.name)

    def _wait_for_start(
        self, controller: ControllerState | None, plant: PlantStatus | None, elapsed: float
    ) -> None:
        """Start the script once the robot is fit for it and balances.

        Raises:
            ScriptError: that takes too long.
        """
        trouble = _trouble(plant)
        if not trouble and _balancing(controller) and self._claimant.has_robot:
            self._program = self._run()
            log.info("script %s: started", self.script.name)
            return
        self._waited += elapsed
        self._troubled = self._troubled + elapsed if trouble else 0.0
        if self._troubled > self.config.trouble_timeout:
            raise ScriptError(f"{trouble}; {REMEDY}, then start the script again")
        late = self._waited > self.config.start_timeout
        if trouble:
            self._waiting_for = f"waiting: {trouble}; {REMEDY}"
        elif not _balancing(controller):
            self._waiting_for = LABEL_WAITING
            shows = "no controller state" if controller is None else controller.state.name
            if late:
                raise ScriptError(
                    f"the controller did not balance within {self.config.start_timeout:g} s; "
                    f"last seen: {shows}"
                )
        else:
            self._waiting_for = f"waiting for the robot: {self._claimant.waits_for()}"
            if late:
                raise ScriptError(
                    f"it did not get the robot within {self.config.start_timeout:g} s: "
                    f"{self._claimant.waits_for()}"
                )

    @property
    def _label(self) -> str:
        """What it does or waits for."""
        if self._ended_for is None and self._program is None:
            return self._waiting_for
        if self._ended_for is None and not self._claimant.has_robot:
            return f"paused: {self._claimant.waits_for()}"
        return self._context.label

    def _run(self) -> Iterator[None]:
        for step in self.script.steps:
            yield from play((step,), self._context)
            self._steps_done += 1

    def _fail(self, reason: str) -> None:
        step = f"step {self._steps_done + 1}/{len(self.script.steps)}"
        mark = f" ({self._context.label})" if self._context.label else ""
        self.failure = f"{step}{mark}: {reason}"
        self._ended_for = 0.0
        log.error("script %s failed: %s", self.script.name, self.failure)

    def _status(self, header: Header, elapsed: float) -> list[Output]:
        status = OperatorStatus(
            script=self.script.name,
            step=self._steps_done,
            steps=len(self.script.steps),
            label=self._label[:200],
            finished=self._ended_for is not None,
            failed=self.failure[:200],
        )
        self._since_shown += elapsed
        if status == self._shown and self._since_shown < STATUS_PERIOD - 1e-3:
            return []
        self._shown, self._since_shown = status, 0.0
        return [Output(TELEOP_STATUS, status.model_copy(update={"header": header}))]


_DONE = object()


def _balancing(controller: ControllerState | None) -> bool:
    return (
        controller is not None
        and controller.state is ControlState.BALANCE
        and controller.gait is Gait.NONE
    )


def _trouble(plant: PlantStatus | None) -> str:
    """Return the plant's condition that prevents a script from running; empty: none."""
    if plant is None:
        return ""
    if plant.guard is GuardMode.ESTOP:
        return "the emergency stop is on" + f" (by {plant.stopped_by})" * bool(plant.stopped_by)
    if plant.fallen:
        return "the robot has fallen"
    return ""
