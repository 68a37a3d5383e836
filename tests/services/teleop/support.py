"""A bench for operators, with a controller that walks by the clock."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from common.runtime.service import Output, Service
from common.schemas import (
    AuthorityChange,
    AuthorityState,
    ControllerState,
    ControlState,
    Gait,
    GaitOutcome,
    GaitReply,
    GaitRequest,
    GuardMode,
    Header,
    Message,
    OperatorClaim,
    OperatorKind,
    PlantStatus,
    Setpoint,
)
from common.topics import (
    PLANT_STATUS,
    TELEOP_CLAIM,
    TELEOP_GAIT,
    WBC_AUTHORITY,
    WBC_REPLY,
    WBC_STATE,
    WBC_TARGET,
    Topic,
)
from services.teleop.targets.targets import OperatorTargets
from tests.services.inputs import FakeInputs

TICK_NS = 50_000_000
BOOT = 77
"""Boot id of the operator on the bench."""


def controller_state(
    state: ControlState = ControlState.BALANCE, gait: Gait = Gait.NONE, completed: int = 0
) -> ControllerState:
    return ControllerState(
        header=Header(stamp=123),
        state=state,
        gait=gait,
        gait_progress=0.0,
        gaits_completed=completed,
        dcm_error=0.0,
        com_in_world=np.zeros(3),
        hand_position_error=np.zeros(2),
        hand_rotation_error=np.zeros(2),
        hand_weight=20.0,
        setpoint_fresh=True,
        solver="daqp",
        unsolved=0,
    )


def plant_status(**changes: Any) -> PlantStatus:
    values: dict[str, Any] = {
        "guard": GuardMode.ACTIVE,
        "paused": False,
        "fallen": False,
        "real_time_factor": 1.0,
        "age_at_torque_median": 0.004,
        "age_at_torque_p99": 0.009,
        "commands_applied": 1,
        "commands_refused": 0,
        "holds": 0,
        "saturated_fraction": 0.0,
        "late_steps": 0,
    }
    return PlantStatus(**(values | changes))


def authority(
    holder: str = "",
    boot: int = 0,
    change: AuthorityChange = AuthorityChange.GRANTED,
    previous: str = "",
    **changes: Any,
) -> AuthorityState:
    """What the controller says; without a holder that somebody has given the robot back."""
    return AuthorityState(
        header=Header(stamp=123),
        holder=holder,
        holder_boot=boot,
        kind=OperatorKind.PERSON,
        changes=1,
        change=change,
        previous=previous,
        previous_boot=0,
        since=100,
        **changes,
    )


NOBODY = authority(change=AuthorityChange.RELEASED, previous="somebody")


def at_left(*position: float) -> Setpoint:
    """A target of the controller whose left hand is at a position [m]."""
    setpoint = OperatorTargets().setpoint(123)
    return setpoint.model_copy(update={"left_hand_position_in_body": np.array(position)})


Answer = Callable[[GaitRequest, int], Sequence[GaitOutcome]]


def accept(_request: GaitRequest, _number: int) -> Sequence[GaitOutcome]:
    return [GaitOutcome.ACCEPTED, GaitOutcome.COMPLETED]


@dataclass
class FakeController:
    """Answers each gait request as ``answer(request, how many came before)`` says.

    The first outcome is sent at once, the second ``gait_seconds`` later; meanwhile it walks.
    With ``mute`` nothing is sent, but an accepted gait still shows in its state. Whoever wants the
    robot gets it, unless ``grants`` is off.
    """

    answer: Answer = accept
    gait_seconds: float = 1.0
    mute: bool = False
    grants: bool = True
    authority: AuthorityState = NOBODY
    claims: list[OperatorClaim] = field(default_factory=list)
    state: ControlState = ControlState.BALANCE
    gait: Gait = Gait.NONE
    completed: int = 0
    requests: list[GaitRequest] = field(default_factory=list)
    _walking: GaitRequest | None = None
    _ends_ns: int = 0
    _last: GaitOutcome | None = None

    def publish(self, inputs: FakeInputs, now_ns: int) -> None:
        replies: list[Message] = []
        if self._walking is not None and now_ns >= self._ends_ns:
            if self._last is not None:
                replies.append(self._reply(self._walking, self._last))
            self.completed += self._last is GaitOutcome.COMPLETED
            self.state, self.gait, self._walking = ControlState.BALANCE, Gait.NONE, None
        inputs.put(WBC_STATE, controller_state(self.state, self.gait, self.completed))
        inputs.put(WBC_AUTHORITY, self.authority.model_copy())
        self._queue(inputs, replies)

    def receive(self, inputs: FakeInputs, outputs: Sequence[Output], now_ns: int) -> None:
        replies: list[Message] = []
        for output in outputs:
            if output.topic is TELEOP_CLAIM:
                assert isinstance(output.message, OperatorClaim)
                self._decide(output.message)
            elif output.topic is TELEOP_GAIT:
                request = output.message
                assert isinstance(request, GaitRequest)
                outcomes = self.answer(request, len(self.requests))
                self.requests.append(request)
                if not outcomes:
                    continue
                replies.append(self._reply(request, outcomes[0]))
                if outcomes[0] is GaitOutcome.ACCEPTED:
                    self.state, self.gait = ControlState.LF_SWING, request.gait
                    self._walking, self._ends_ns = request, now_ns + int(self.gait_seconds * 1e9)
                    self._last = outcomes[1] if len(outcomes) > 1 else None
        self._queue(inputs, replies)

    def _decide(self, claim: OperatorClaim) -> None:
        self.claims.append(claim)
        mine = self.authority.holder_boot == BOOT
        if claim.wants and not mine and not self.authority.holder and self.grants:
            self._say(authority("operator", BOOT))
        elif mine and not claim.wants:
            self._say(authority(change=AuthorityChange.RELEASED, previous="operator"))

    def _say(self, said: AuthorityState) -> None:
        self.authority = said.model_copy(update={"changes": self.authority.changes + 1})

    def _queue(self, inputs: FakeInputs, replies: list[Message]) -> None:
        if not self.mute:
            inputs.queues.setdefault(WBC_REPLY.name, []).extend(replies)

    @staticmethod
    def _reply(request: GaitRequest, outcome: GaitOutcome) -> GaitReply:
        return GaitReply(
            request_id=request.request_id, gait=request.gait, outcome=outcome, reason="because"
        )


@dataclass
class Bench:
    """Steps a service at 20 Hz against a fake controller and keeps what it published."""

    service: Service
    controller: FakeController = field(default_factory=FakeController)
    inputs: FakeInputs = field(default_factory=FakeInputs)
    now_ns: int = 7_000_000_000
    sent: list[tuple[int, Output]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.service.boot = BOOT
        self.inputs.put(PLANT_STATUS, plant_status())
        self.inputs.put(WBC_TARGET, OperatorTargets().setpoint(123))

    def tick(self, dt_ns: int = TICK_NS) -> Sequence[Output]:
        self.now_ns += dt_ns
        self.controller.publish(self.inputs, self.now_ns)
        outputs = self.service.step(self.inputs, self.now_ns)
        self.inputs.begin_step()
        self.controller.receive(self.inputs, outputs, self.now_ns)
        self.sent += [(self.now_ns, output) for output in outputs]
        return outputs

    def run(self, seconds: float) -> "Bench":
        """Step until the service ends itself, or for ``seconds`` at most."""
        for _ in range(round(seconds * 1e9 / TICK_NS)):
            if self.service.exit_code is not None:
                break
            self.tick()
        return self

    def messages(self, topic: Topic[Any]) -> list[Any]:
        return [output.message for _, output in self.sent if output.topic is topic]

    def times(self, topic: Topic[Any]) -> list[int]:
        return [time for time, output in self.sent if output.topic is topic]
