"""The controller as a service: inboxes in, joint commands and controller state out."""

from collections.abc import Sequence

import numpy as np

from common.runtime.service import Inputs, Output, Service
from common.schemas import (
    ControllerState,
    GaitOutcome,
    GaitReply,
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
from services.wbc.controller import Command, Controller, TickReport, joint_gains
from services.wbc.requests import RequestBook


class WbcService(Service):
    """Whole-body controller, ticking at ``config.rate`` and phase-locked to the plant's state.

    A reset of the plant (its ``reset_count`` changes, or robot time jumps back) starts a fresh
    controller, as does a restart of this process: it takes over from the measured posture.
    """

    name = "wbc"
    reads = (PLANT_STATE, TELEOP_SETPOINT, TELEOP_GAIT)
    writes = (WBC_COMMAND, WBC_STATE, WBC_REPLY)
    trigger = PLANT_STATE

    def __init__(self, config: WbcConfig | None = None) -> None:
        self.config = config or WbcConfig()
        self.period_ns = round(1e9 / self.config.rate)
        self.controller = Controller(self.config)
        self.stiffness, self.damping = joint_gains(self.config.motors)
        self._book = RequestBook()
        self._reset_count: int | None = None
        self._stamp = -1
        self._unsolved_before = 0

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """One tick; silent while there is no newer state to control."""
        state = inputs.latest(PLANT_STATE)
        requests = inputs.events(TELEOP_GAIT)
        if state is None or state.header.stamp == self._stamp:
            # Without a new state there is nothing to control; the plant's guard counts the silence.
            return [
                self._reply(r.request_id, r.gait, GaitOutcome.REFUSED, "no fresh plant state")
                for r in requests
            ]
        self._restart_if_needed(state)
        self._stamp = state.header.stamp
        time = state.header.stamp * 1e-9
        setpoint = inputs.latest(TELEOP_SETPOINT)
        if setpoint is not None and inputs.updated(TELEOP_SETPOINT):
            self.controller.set_setpoint(setpoint, time)
        repeated = [reply for r in requests if (reply := self._book.answered(r)) is not None]
        for request in requests:
            if (number := self._book.enter(request)) is not None:
                self.controller.request(number, request.gait)
        command, report = self.controller.tick(state, time)
        header = Header(stamp=state.header.stamp)
        outputs = [
            Output(WBC_COMMAND, self._joint_command(command, header)),
            Output(WBC_STATE, self._controller_state(report, time, header, inputs)),
        ]
        for answer in self.controller.locomotion.answers():
            self._book.note(answer)
            request_id = self._book.request_id(answer)
            outputs.append(self._reply(request_id, answer.gait, answer.outcome, answer.reason))
        for reply in repeated:
            outputs.append(self._reply(reply.request_id, reply.gait, reply.outcome, reply.reason))
        return outputs

    def _restart_if_needed(self, state: PlantState) -> None:
        known, now = self._reset_count, state.reset_count
        went_back = state.header.stamp < self._stamp
        if known is not None and (known != now or went_back):
            self._unsolved_before += self.controller.unsolved
            self.controller = Controller(self.config)
            self._book = RequestBook()
        self._reset_count = now

    def _joint_command(self, command: Command, header: Header) -> JointCommand:
        return JointCommand(
            header=header,
            position=command.position,
            velocity=command.velocity,
            acceleration=command.acceleration,
            torque=command.torque,
            stiffness=self.stiffness,
            damping=self.damping,
            gripper_closure=self.controller.gripper,
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
            gaits_completed=locomotion.completed,
            dcm_error=report.dcm_error,
            com_in_world=report.com,
            hand_position_error=np.ascontiguousarray(report.hand_error[:, 0]),
            hand_rotation_error=np.ascontiguousarray(report.hand_error[:, 1]),
            hand_weight=self.controller.hand_weight,
            setpoint_fresh=inputs.fresh(TELEOP_SETPOINT),
            solver=self.controller.solver.name,
            unsolved=self._unsolved_before + self.controller.unsolved,
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
