"""The controller as a service: inboxes in, joint commands and controller state out."""

import logging
from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np
from pydantic import ValidationError

from common.errors import ConfigError, explain
from common.runtime.service import Inputs, Output, Service
from common.schemas import (
    ControllerState,
    GaitOutcome,
    GaitReply,
    GaitRequest,
    Header,
    JointCommand,
    PlantState,
)
from common.topics import (
    PLANT_STATE,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    WBC_COMMAND,
    WBC_REPLY,
    WBC_STATE,
)
from services.wbc.config import WbcConfig
from services.wbc.controller import Command, Controller, TickReport
from services.wbc.motors import joint_gains
from services.wbc.requests import RequestTracker

LONGEST_GAP_NS = 120_000_000
"""States further apart than this [ns] mean that the plant's guard has been holding the robot."""
_LOG = logging.getLogger(__name__)


class WbcService(Service):
    """Whole-body controller, ticking at ``config.rate`` and phase-locked to the plant's state.

    After a reset of the plant or a long silence, as after a restart of this process, it forgets
    its plans and takes over from the measured posture. The gait in progress is answered ABORTED.
    """

    name = "wbc"
    reads = (PLANT_STATE, TELEOP_SETPOINT, TELEOP_GAIT)
    writes = (WBC_COMMAND, WBC_STATE, WBC_REPLY)
    trigger = PLANT_STATE

    def __init__(self, config: WbcConfig | None = None) -> None:
        self.config = config or WbcConfig()
        self.settings = self.config.model_dump(mode="json")
        self.period_ns = round(1e9 / self.config.rate)
        self.controller = Controller(self.config)
        self.stiffness, self.damping = joint_gains(self.config.motors)
        self._book = RequestTracker()
        self._reset_count: int | None = None
        self._stamp = -1
        self._setpoint_due = False
        self._completed_before = 0
        self._requests: list[GaitRequest] = []

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Build a controller to be replayed; it dumps no QPs."""
        try:
            return cls(WbcConfig.model_validate({**settings, "qp_dump_dir": ""}))
        except ValidationError as error:
            raise ConfigError(f"the controller's settings are wrong: {explain(error)}") from error

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """One tick; silent while there is no newer state to control."""
        state = inputs.latest(PLANT_STATE)
        self._setpoint_due = self._setpoint_due or inputs.updated(TELEOP_SETPOINT)
        self._requests += inputs.events(TELEOP_GAIT)
        if state is None or state.header.stamp == self._stamp:
            return self._without_state(inputs)
        outputs = self._restart_if_needed(state)
        self._stamp = state.header.stamp
        time = state.header.stamp * 1e-9
        setpoint = inputs.latest(TELEOP_SETPOINT)
        if setpoint is not None and self._setpoint_due:
            self._setpoint_due = False
            self.controller.set_setpoint(setpoint, time)
        outputs += self._take_requests()
        command, report = self.controller.tick(state, time)
        header = Header(stamp=state.header.stamp)
        outputs += [
            Output(WBC_COMMAND, self._joint_command(command, state)),
            Output(WBC_STATE, self._controller_state(report, time, header, inputs)),
        ]
        for answer in self.controller.locomotion.answers():
            self._book.note(answer)
            request_id = self._book.request_id(answer)
            outputs.append(self._reply(request_id, answer.gait, answer.outcome, answer.reason))
        return outputs

    def _without_state(self, inputs: Inputs) -> list[Output]:
        """Nothing to control; requests wait for the next state unless the plant is gone."""
        if inputs.fresh(PLANT_STATE):
            return []
        requests, self._requests = self._requests, []
        return [
            self._reply(r.request_id, r.gait, GaitOutcome.REFUSED, "no fresh plant state")
            for r in requests
        ]

    def _take_requests(self) -> list[Output]:
        """Pass new requests on; answer repeated ones with what is already known."""
        outputs = []
        requests, self._requests = self._requests, []
        for request in requests:
            known = self._book.answered(request)
            if known is not None:
                outputs.append(
                    self._reply(known.request_id, known.gait, known.outcome, known.reason)
                )
            elif (number := self._book.enter(request)) is not None:
                self.controller.request(number, request.gait)
        return outputs

    def _restart_if_needed(self, state: PlantState) -> list[Output]:
        """Start afresh if the robot is no longer where the controller left it.

        After a reset it stands elsewhere; after a silence the plant's guard has held it, and a
        plan that went on meanwhile would be far ahead of the feet.
        """
        reason = ""
        if self._reset_count not in (None, state.reset_count) or state.header.stamp < self._stamp:
            reason = "the plant was reset"
        elif self._stamp >= 0 and state.header.stamp - self._stamp > LONGEST_GAP_NS:
            gap = (state.header.stamp - self._stamp) * 1e-9
            reason = f"the controller was silent for {gap:.2f} s"
        self._reset_count = state.reset_count
        if not reason:
            return []
        _LOG.warning("starting afresh: %s", reason)
        aborted = self.controller.locomotion.abort(reason)
        outputs = []
        if aborted is not None:
            self._book.note(aborted)
            request_id = self._book.request_id(aborted)
            outputs = [self._reply(request_id, aborted.gait, aborted.outcome, aborted.reason)]
        self._completed_before += self.controller.locomotion.completed
        self.controller.restart()
        return outputs

    def _joint_command(self, command: Command, state: PlantState) -> JointCommand:
        return JointCommand(
            header=Header(stamp=state.header.stamp),
            position=command.position,
            velocity=command.velocity,
            acceleration=command.acceleration,
            torque=command.torque,
            stiffness=self.stiffness,
            damping=self.damping,
            gripper_closure=self.controller.gripper(state),
        )

    def _controller_state(
        self,
        report: TickReport,
        time: float,
        header: Header,
        inputs: Inputs,
    ) -> ControllerState:
        locomotion = self.controller.locomotion
        return ControllerState(
            header=header,
            state=locomotion.state,
            gait=locomotion.gait,
            gait_progress=locomotion.progress(time),
            gaits_completed=self._completed_before + locomotion.completed,
            dcm_error=report.dcm_error,
            com_in_world=report.com,
            hand_position_error=np.ascontiguousarray(report.hand_error[:, 0]),
            hand_rotation_error=np.ascontiguousarray(report.hand_error[:, 1]),
            hand_weight=self.controller.hand_weight,
            setpoint_fresh=inputs.fresh(TELEOP_SETPOINT),
            solver=self.controller.solver.name,
            unsolved=self.controller.unsolved,
        )

    def _reply(self, request_id: int, gait: object, outcome: GaitOutcome, reason: str) -> Output:
        message = GaitReply.model_validate(
            {
                "header": Header(stamp=max(0, self._stamp)),
                "request_id": request_id,
                "gait": gait,
                "outcome": outcome,
                "reason": reason[:200],
            }
        )
        return Output(WBC_REPLY, message)
