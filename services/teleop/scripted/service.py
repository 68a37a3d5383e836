"""The scripted operator as a service: plays a script, then ends its process."""

import logging
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field

from common.runtime.service import Inputs, Output, Service
from common.schemas import (
    ControllerState,
    ControlState,
    Gait,
    GuardMode,
    Header,
    OperatorStatus,
    PlantStatus,
)
from common.tables import validated
from common.topics import (
    PLANT_STATUS,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    TELEOP_STATUS,
    WBC_REPLY,
    WBC_STATE,
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


class ScriptedConfig(BaseModel):
    """Configuration of the scripted operator."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    limits: MotionLimits = MotionLimits()
    patience: GaitPatience = GaitPatience()
    start_timeout: float = Field(default=60.0, gt=0.0, description="timeout until BALANCE [s]")
    silence_timeout: float = Field(
        default=3.0, gt=0.0, description="time without a controller state after which it fails [s]"
    )
    linger: float = Field(
        default=1.0, ge=0.0, description="time to go on with set-points after the script [s]"
    )


class ScriptedOperator(Service):
    """Publishes set-points at 20 Hz, and the script's gait requests once the robot balances.

    After the script it goes on for ``linger`` seconds and sets ``exit_code``: 0, or 1 when the
    script failed, with the reason in :attr:`failure`. The script's clock stops while the plant is
    paused. Request ids start at the runner's clock in milliseconds, so that they are greater than
    those of an earlier operator.
    """

    name = "teleop"
    period_ns = PERIOD_NS
    reads = (WBC_STATE, WBC_REPLY, PLANT_STATUS)
    writes = (TELEOP_SETPOINT, TELEOP_GAIT, TELEOP_STATUS)

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
        self._context = ScriptContext(
            self.targets, GaitClient(self.config.patience), label=LABEL_WAITING
        )
        self._program: Iterator[None] | None = None
        self._steps_done = 0
        self._waited = 0.0
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
        context = self._context
        context.dt = 0.0 if paused else min(elapsed, LONGEST_STEP)
        controller = inputs.latest(WBC_STATE)
        fresh = controller if inputs.fresh(WBC_STATE) else None
        # Replies and timeouts run on real time, however late this step is.
        context.gaits.update(0.0 if paused else elapsed, inputs.events(WBC_REPLY), fresh)
        try:
            self._act(inputs, fresh, plant, elapsed)
        except ScriptError as error:
            self._fail(str(error))
        self.targets.advance(context.dt)

        stamp = 0 if controller is None else controller.header.stamp
        header = Header(stamp=stamp)
        outputs = [Output(TELEOP_SETPOINT, self.targets.setpoint(stamp))]
        requests, context.gaits.outbox = context.gaits.outbox, []
        outputs += [
            Output(TELEOP_GAIT, request.model_copy(update={"header": header}))
            for request in requests
        ]
        return outputs + self._status(header, elapsed)

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
                self.exit_code = 1 if self.failure else 0
        elif self._program is None:
            self._wait_for_balance(controller, plant, elapsed)
        else:
            if trouble := _trouble(plant):
                raise ScriptError(trouble)
            silent = inputs.age(WBC_STATE)
            paused = plant is not None and plant.paused
            if silent > self.config.silence_timeout and not paused:
                raise ScriptError(f"the controller has been silent for {silent:.1f} s")
            if next(self._program, _DONE) is _DONE:
                self._ended_for = 0.0
                log.info("script %s: finished", self.script.name)

    def _wait_for_balance(
        self, controller: ControllerState | None, plant: PlantStatus | None, elapsed: float
    ) -> None:
        trouble = _trouble(plant)
        if not trouble and _balancing(controller):
            self._context.label = ""
            self._program = self._run()
            log.info("script %s: started", self.script.name)
            return
        self._waited += elapsed
        if self._waited > self.config.start_timeout:
            shows = "no controller state" if controller is None else controller.state.name
            raise ScriptError(
                f"the controller did not balance within {self.config.start_timeout:g} s; "
                f"last seen: {trouble or shows}"
            )

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
            label=self._context.label,
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
    if plant.fallen:
        return "the robot has fallen"
    if plant.guard is GuardMode.ESTOP:
        return "the emergency stop is on"
    return ""
