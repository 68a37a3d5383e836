"""The whole-body controller as a service."""

import logging
from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np

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
from common.tables import validated
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
from services.wbc.requests import RequestTracker

LONGEST_GAP_NS = 120_000_000
"""Gap between states after which the plant's guard has been holding the robot [ns]."""
_LOG = logging.getLogger(__name__)


class WbcService(Service):
    """Whole-body controller that ticks at ``config.rate``, phase-locked to the plant's state.

    After a reset of the plant or a long silence, as after a restart of this process, it discards
    its plans and takes over from the measured posture. A gait in progress is answered ABORTED.
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
        self.stiffness, self.damping = self.config.motors.per_joint()
        self._tracker = RequestTracker()
        self._reset_count: int | None = None
        self._stamp = -1
        self._setpoint_due = False
        self._completed_before = 0
        self._requests: list[GaitRequest] = []

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Build the controller for a replay; it dumps no QPs."""
        return cls(validated(WbcConfig, settings, {"qp_dump_dir": ""}))

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Run one control tick; without a newer state only gait requests are answered."""
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
            self._tracker.record(answer)
            request_id = self._tracker.request_id(answer)
            outputs.append(self._reply(request_id, answer.gait, answer.outcome, answer.reason))
        return outputs

    def _without_state(self, inputs: Inputs) -> list[Output]:
        """Refuse gait requests if the plant is gone; else keep them for the next state."""
        if inputs.fresh(PLANT_STATE):
            return []
        requests, self._requests = self._requests, []
        return [
            self._reply(r.request_id, r.gait, GaitOutcome.REFUSED, "no fresh plant state")
            for r in requests
        ]

    def _take_requests(self) -> list[Output]:
        """Start new gait requests; answer repeated ones with the latest answer."""
        outputs = []
        requests, self._requests = self._requests, []
        for request in requests:
            known = self._tracker.answer_to(request)
            if known is not None:
                outputs.append(
                    self._reply(known.request_id, known.gait, known.outcome, known.reason)
                )
            elif (number := self._tracker.register(request)) is not None:
                self.controller.request(number, request.gait)
        return outputs

    def _restart_if_needed(self, state: PlantState) -> list[Output]:
        """Restart the controller if the robot is not where the plans expect it.

        After a reset it stands elsewhere; after a silence the plant's guard has held it, and the
        plans would be far ahead of the feet.
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
        _LOG.warning("restarting the controller: %s", reason)
        aborted = self.controller.locomotion.abort(reason)
        outputs = []
        if aborted is not None:
            self._tracker.record(aborted)
            request_id = self._tracker.request_id(aborted)
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
