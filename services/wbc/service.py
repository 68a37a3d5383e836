"""The whole-body controller as a service."""

import logging
from collections.abc import Mapping, Sequence
from math import inf
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
    Sender,
    Setpoint,
)
from common.tables import validated
from common.topics import (
    PLANT_STATE,
    TELEOP_CLAIM,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    WBC_AUTHORITY,
    WBC_COMMAND,
    WBC_REPLY,
    WBC_STATE,
    WBC_TARGET,
)
from services.wbc.authority import Authority
from services.wbc.config import WbcConfig
from services.wbc.controller import Command, Controller, TickReport
from services.wbc.locomotion import Answer
from services.wbc.plant_watch import PlantWatch
from services.wbc.requests import RequestTracker

AUTHORITY_PERIOD_NS = 100_000_000
TARGET_PERIOD_NS = 50_000_000
REQUESTS_PER_TICK = 50
"""Gait requests answered in one tick: a flood of them must not stop the control loop."""
_REMINDER_NS = 1_000_000_000
"""Time after which it is said again that the plant is another controller's, or unfit [ns]."""
_LOG = logging.getLogger(__name__)


class WbcService(Service):
    """Whole-body controller that ticks at ``config.rate``, phase-locked to the plant's state.

    It follows the set-points and gait requests of one operator at a time. After a reset of the
    plant or a long silence, as after a restart of this process, it discards its plans and takes
    over from the measured posture. A gait in progress is answered ABORTED. While the plant follows
    another controller, that one answers the gait requests.
    """

    name = "wbc"
    reads = (PLANT_STATE, TELEOP_CLAIM, TELEOP_SETPOINT, TELEOP_GAIT)
    writes = (WBC_COMMAND, WBC_STATE, WBC_REPLY, WBC_AUTHORITY, WBC_TARGET)
    trigger = PLANT_STATE

    def __init__(self, config: WbcConfig | None = None) -> None:
        self.config = config or WbcConfig()
        self.settings = self.config.model_dump(mode="json")
        self.period_ns = round(1e9 / self.config.rate)
        self.controller = Controller(self.config)
        self.stiffness, self.damping = self.config.motors.per_joint()
        self._watch = PlantWatch(self.config.limits.torque_mode)
        self._authority = Authority(self.config.authority)
        self._tracker = RequestTracker()
        self._stamp = -1
        self._completed_before = 0
        self._requests: list[GaitRequest] = []
        self._seen: Mapping[Sender, Setpoint] = {}
        self._setpoints: dict[Sender, Setpoint] = {}
        self._setpoint_stamp, self._setpoint_time = 0, -inf
        self._authority_shown = self._target_shown = -AUTHORITY_PERIOD_NS
        self._warned, self._warned_at = "", 0

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Build the controller for a replay; it dumps no QPs."""
        return cls(validated(WbcConfig, settings, {"qp_dump_dir": ""}))

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Run one control tick; without a newer state only gait requests are answered."""
        state = inputs.latest(PLANT_STATE)
        self._collect(inputs)
        if state is None or state.header.stamp == self._stamp:
            return self._without_state(inputs)
        outputs = self._restart_if_needed(state)
        self._stamp = state.header.stamp
        time = state.header.stamp * 1e-9
        outputs += self._update_authority(inputs)
        self._follow_setpoint(time)
        outputs += self._take_requests()
        command, report = self.controller.tick(state, time)
        if not self._watch.misfit:
            outputs.append(Output(WBC_COMMAND, self._joint_command(command, state)))
        outputs += [
            Output(WBC_STATE, self._controller_state(report, time)),
            *self._answers(self.controller.locomotion.answers()),
        ]
        if abs(self._stamp - self._target_shown) >= TARGET_PERIOD_NS:
            self._target_shown = self._stamp
            outputs.append(Output(WBC_TARGET, self.controller.target.setpoint(self._stamp)))
        return outputs

    def _collect(self, inputs: Inputs) -> None:
        """Keep what operators sent until a state comes."""
        self._requests += inputs.events(TELEOP_GAIT)
        if inputs.updated(TELEOP_SETPOINT):
            known, self._seen = self._seen, inputs.latest_by_sender(TELEOP_SETPOINT)
            self._setpoints |= {
                sender: setpoint
                for sender, setpoint in self._seen.items()
                if setpoint is not known.get(sender)
            }

    def _without_state(self, inputs: Inputs) -> list[Output]:
        """Refuse gait requests if the plant is gone; else keep them for the next state."""
        if inputs.fresh(PLANT_STATE):
            return []
        requests, self._requests = self._requests, []
        return [self._reply(r, GaitOutcome.REFUSED, "no fresh plant state") for r in requests]

    def _update_authority(self, inputs: Inputs) -> list[Output]:
        """Decide who has the robot; return each change, or the decision in force at 10 Hz."""
        authority = self._authority
        claims = inputs.latest_by_sender(TELEOP_CLAIM)
        changes = authority.update(self._stamp, claims, stopped=self._watch.stopped)
        if changes:
            self.controller.hand_over.begin()
            self._setpoint_stamp, self._setpoint_time = 0, -inf
        elif abs(self._stamp - self._authority_shown) >= AUTHORITY_PERIOD_NS:
            changes = [authority.state]
        else:
            return []
        self._authority_shown = self._stamp
        return [Output(WBC_AUTHORITY, change) for change in changes]

    def _follow_setpoint(self, time: float) -> None:
        """Apply the set-point of the operator that has the robot, if it sent one."""
        if not self.controller.started:
            return
        setpoints, self._setpoints = self._setpoints, {}
        holder = self._authority.holder
        setpoint = None if holder is None else setpoints.pop(holder, None)
        self._authority.ignored += len(setpoints)
        if setpoint is not None:
            self.controller.set_setpoint(setpoint, time)
            self._setpoint_stamp, self._setpoint_time = setpoint.header.stamp, time

    def _take_requests(self) -> list[Output]:
        """Start new gait requests; answer repeated ones with the latest answer."""
        outputs = []
        requests, self._requests = (
            self._requests[:REQUESTS_PER_TICK],
            self._requests[REQUESTS_PER_TICK:],
        )
        for request in requests:
            known = self._tracker.answer_to(request)
            if known is not None:
                outputs.append(self._reply(request, known.outcome, known.reason))
            elif self._watch.bystander:
                continue  # the controller that has the plant answers
            elif request.controller_boot not in (0, self.boot):
                reason = "the controller was restarted"
                outputs.append(self._reply(request, GaitOutcome.ABORTED, reason))
            elif refusal := self._refusal(request):
                outputs.append(self._reply(request, GaitOutcome.REFUSED, refusal))
            elif (number := self._tracker.register(request)) is not None:
                self.controller.request(number, request.gait)
        return outputs

    def _refusal(self, request: GaitRequest) -> str:
        """Return why a request is not passed to the state machine; empty: it is."""
        holder, sender = self._authority.holder, request.header.sender
        if sender != holder:
            self._authority.ignored += 1
            state = "nobody has the robot" if holder is None else f"{holder.source} has the robot"
            return f"{sender.source or 'the sender'} may not walk it: {state}"
        return self._watch.obstacle

    def _restart_if_needed(self, state: PlantState) -> list[Output]:
        """Restart the controller if the robot is not where the plans expect it.

        After a reset it stands elsewhere; after a silence the plant's guard has held it, and the
        plans would be far ahead of the feet. While it does not obey, it moves by itself.
        """
        reason = self._watch.update(state, self.boot)
        if not reason:
            self._warned = self._warned if self._watch.obstacle else ""
            return []
        standing = self._watch.bystander or bool(self._watch.misfit)
        reminder = standing and state.header.stamp - self._warned_at >= _REMINDER_NS
        if reason != self._warned or reminder:
            self._warned, self._warned_at = reason, state.header.stamp
            _LOG.warning("restarting the controller: %s", reason)
        aborted = self.controller.locomotion.abort(reason)
        self._completed_before += self.controller.locomotion.completed
        self.controller.restart()
        return [] if aborted is None else self._answers([aborted])

    def _joint_command(self, command: Command, state: PlantState) -> JointCommand:
        return JointCommand(
            header=Header(stamp=state.header.stamp),
            position=command.position,
            velocity=command.velocity,
            acceleration=command.acceleration,
            torque=command.torque,
            stiffness=self.stiffness,
            damping=self.damping,
            gripper_closure=self.controller.grippers,
        )

    def _controller_state(self, report: TickReport, time: float) -> ControllerState:
        locomotion = self.controller.locomotion
        return ControllerState(
            header=Header(stamp=self._stamp),
            state=locomotion.state,
            gait=locomotion.gait,
            gait_progress=locomotion.progress(time),
            gaits_completed=self._completed_before + locomotion.completed,
            dcm_error=report.dcm_error,
            com_in_world=report.com,
            hand_position_error=np.ascontiguousarray(report.hand_error[:, 0]),
            hand_rotation_error=np.ascontiguousarray(report.hand_error[:, 1]),
            hand_weight=self.controller.hand_weight,
            setpoint_fresh=time - self._setpoint_time <= self.config.hands.stale_after,
            solver=self.controller.solver.name,
            unsolved=self.controller.unsolved,
            setpoint_stamp=self._setpoint_stamp,
            obstacle=self._watch.obstacle,
        )

    def _answers(self, answers: Sequence[Answer]) -> list[Output]:
        """Send the answers of the state machine to those who asked."""
        return [
            self._reply(self._tracker.record(answer), answer.outcome, answer.reason)
            for answer in answers
        ]

    def _reply(self, request: GaitRequest, outcome: GaitOutcome, reason: str) -> Output:
        message = GaitReply(
            header=Header(stamp=max(0, self._stamp)),
            request_id=request.request_id,
            gait=request.gait,
            outcome=outcome,
            reason=reason[:200],
            requester_boot=request.header.boot,
        )
        return Output(WBC_REPLY, message)
