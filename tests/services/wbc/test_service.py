"""The service at its boundary: which messages make it speak, and what it says."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from common.robot.rotations import matrix_from_quaternion
from common.runtime.service import Output
from common.schemas import (
    ControllerState,
    ControlState,
    Gait,
    GaitOutcome,
    GaitReply,
    Header,
    JointCommand,
    Message,
    PlantState,
    Sender,
)
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
    Topic,
)
from common.wire.codec import encode
from services.wbc.config import WbcConfig
from services.wbc.hands import HandReference
from services.wbc.plant_watch import LONGEST_GAP_NS
from services.wbc.service import WbcService
from tests.services.inputs import FakeInputs

from .bench import Bench
from .support import MS, OPERATOR, claim, nominal_state, request, setpoint

CONFIG = WbcConfig(solver="daqp", stand_time=0.3)
Sent = list[tuple[Topic[Any], Message]]


class Desk:
    """A service whose every input is put by hand; states are all of the nominal crouch.

    One operator has the robot from the first state on; only what concerns it less is left out of
    what is returned.
    """

    def __init__(self, config: WbcConfig = CONFIG) -> None:
        self.service = WbcService(config)
        self.inputs = FakeInputs()

        self.claims = 0

    def step(self, *messages: tuple[Topic[Any], Message]) -> Sequence[Output]:
        self.inputs.begin_step()
        self.claims += 1
        self.inputs.put(TELEOP_CLAIM, claim(self.claims))
        for topic, message in messages:
            self.inputs.put(topic, message)
        outputs = self.service.step(self.inputs, 0)
        return [o for o in outputs if o.topic not in (WBC_AUTHORITY, WBC_TARGET)]

    def state(self, stamp_ms: int, *messages: tuple[Topic[Any], Message], resets: int = 0) -> Sent:
        state = nominal_state(stamp_ms * MS, reset_count=resets)
        return [(o.topic, o.message) for o in self.step((PLANT_STATE, state), *messages)]

    def adopt(self, stamp_ms: int) -> None:
        """The operator begins at the present target, so that it is followed at once from then."""
        self.state(stamp_ms)
        target = self.service.controller.target.setpoint(0)
        header = Header(source=OPERATOR.source, boot=OPERATOR.boot)
        message = target.model_copy(update={"header": header})
        self.state(stamp_ms + 10, (TELEOP_SETPOINT, message))

    def stand(self) -> int:
        """Until it balances; returns the last stamp [ms]."""
        for stamp in range(1000, 1330, 10):
            self.state(stamp)
        assert self.service.controller.locomotion.state is ControlState.BALANCE
        return stamp


def _of(sent: Sent, kind: type[Any]) -> list[Any]:
    return [message for _, message in sent if isinstance(message, kind)]


def _request(request_id: int, gait: Gait = Gait.FORWARD, sender: Sender = OPERATOR) -> Any:
    return TELEOP_GAIT, request(request_id, gait, sender)


def test_contract() -> None:
    service = WbcService(WbcConfig(rate=200.0))
    assert service.name == "wbc"
    assert service.period_ns == 5_000_000
    assert service.trigger is PLANT_STATE
    assert set(service.reads) == {PLANT_STATE, TELEOP_CLAIM, TELEOP_SETPOINT, TELEOP_GAIT}
    assert set(service.writes) == {WBC_COMMAND, WBC_STATE, WBC_REPLY, WBC_AUTHORITY, WBC_TARGET}


def test_without_a_state_it_is_silent_and_refuses() -> None:
    desk = Desk()
    assert desk.step() == []
    assert desk.step((TELEOP_SETPOINT, setpoint())) == []
    (output,) = desk.step(_request(5, Gait.TURN_LEFT))
    assert output.topic is WBC_REPLY
    reply = output.message
    assert isinstance(reply, GaitReply)
    assert (reply.request_id, reply.gait) == (5, Gait.TURN_LEFT)
    assert reply.outcome is GaitOutcome.REFUSED
    assert reply.reason == "no fresh plant state"


def test_one_answer_per_state() -> None:
    desk = Desk()
    state = PLANT_STATE, nominal_state(1000 * MS)
    assert [o.topic for o in desk.step(state)] == [WBC_COMMAND, WBC_STATE]
    assert desk.step() == []
    assert desk.step(state) == []
    assert [topic for topic, _ in desk.state(1005)] == [WBC_COMMAND, WBC_STATE]


def test_outputs_bear_the_stamp_of_their_state() -> None:
    desk = Desk()
    sent = desk.state(1234, _request(1))
    assert len(sent) == 3
    assert {message.header.stamp for _, message in sent} == {1234 * MS}


def test_command_carries_gains_and_grippers() -> None:
    desk = Desk()
    desk.adopt(990)
    (command,) = _of(
        desk.state(1010, (TELEOP_SETPOINT, setpoint(closure=(0.5, 1.0)))), JointCommand
    )
    stiffness, damping = CONFIG.motors.per_joint()
    assert np.array_equal(command.stiffness, stiffness)
    assert np.array_equal(command.damping, damping)
    assert command.gripper_closure.tolist() == [0.5, 1.0]
    (command,) = _of(desk.state(1020), JointCommand)
    assert command.gripper_closure.tolist() == [0.5, 1.0]


def test_a_setpoint_counts_once_when_it_arrives() -> None:
    desk = Desk()
    desk.adopt(990)
    hand = desk.service.controller.hands[0]
    alone = HandReference("left", CONFIG.hands)
    alone.hold(*hand.target, 1.0)
    message = setpoint(left=np.array([0.4, 0.2, 0.1]))
    desk.state(1010, (TELEOP_SETPOINT, message))
    alone.set(
        message.left_hand_position_in_body,
        matrix_from_quaternion(message.left_hand_quaternion_in_body),
        1.01,
    )
    # Taken anew with every state it would be another target, at rest, and never grow stale.
    for stamp in range(1020, 1600, 10):
        (report,) = _of(desk.state(stamp), ControllerState)
        one, other = hand.at(stamp * 1e-3), alone.at(stamp * 1e-3)
        assert np.abs(one.position - other.position).max() < 1e-12
        assert np.abs(one.velocity - other.velocity).max() < 1e-9
        assert report.setpoint_fresh == (stamp <= 1260)


def test_a_setpoint_between_two_states_is_not_lost() -> None:
    desk = Desk()
    desk.adopt(990)
    goal = np.array([0.4, 0.2, 0.1])
    desk.step((TELEOP_SETPOINT, setpoint(left=goal)))
    desk.state(1010)
    assert desk.service.controller.target.positions[0] == pytest.approx(goal, abs=1e-12)


def test_a_request_between_two_states_waits() -> None:
    desk = Desk()
    stamp = desk.stand()
    assert desk.step(_request(9)) == []
    (reply,) = _of(desk.state(stamp + 10), GaitReply)
    assert (reply.request_id, reply.outcome) == (9, GaitOutcome.ACCEPTED)


def test_requests_are_refused_when_the_plant_is_gone() -> None:
    desk = Desk()
    desk.stand()
    desk.inputs.stale.add(PLANT_STATE.name)
    (output,) = desk.step(_request(9))
    assert isinstance(output.message, GaitReply)
    assert output.message.outcome is GaitOutcome.REFUSED
    assert output.message.reason == "no fresh plant state"


def test_a_gait_is_accepted_walked_and_completed() -> None:
    desk = Desk()
    stamp = desk.stand()
    (report,) = _of(desk.state(stamp + 10, _request(3, Gait.SIDE_LEFT)), ControllerState)
    assert report.gait is Gait.SIDE_LEFT
    replies: list[GaitReply] = []
    shares: list[float] = []
    for k in range(2, 345):
        sent = desk.state(stamp + 10 * k)
        replies += _of(sent, GaitReply)
        shares += [s.gait_progress for s in _of(sent, ControllerState)]
    assert [(r.request_id, r.outcome) for r in replies] == [(3, GaitOutcome.COMPLETED)]
    assert max(shares) > 0.99
    (report,) = _of(desk.state(stamp + 3450), ControllerState)
    assert (report.gait, report.gait_progress, report.gaits_completed) == (Gait.NONE, 0.0, 1)


def test_a_repeated_request_is_answered_but_not_walked_again() -> None:
    desk = Desk()
    stamp = desk.stand()
    first = _of(desk.state(stamp + 10, _request(3)), GaitReply)
    again = _of(desk.state(stamp + 20, _request(3)), GaitReply)
    assert [(r.request_id, r.outcome) for r in first + again] == [(3, GaitOutcome.ACCEPTED)] * 2
    (other,) = _of(desk.state(stamp + 30, _request(4)), GaitReply)
    assert other.outcome is GaitOutcome.REFUSED
    assert "FORWARD is still in progress" in other.reason


@pytest.mark.parametrize(
    ("gap_ms", "resets", "reason"),
    [
        (10, 1, "the plant was reset"),
        (-500, 0, "the plant was reset"),
        (LONGEST_GAP_NS // MS + 10, 0, "the controller was silent for 0.13 s"),
    ],
)
def test_a_robot_that_moved_without_it_is_taken_over_afresh(
    gap_ms: int, resets: int, reason: str
) -> None:
    desk = Desk()
    stamp = desk.stand()
    desk.state(stamp + 10, _request(7))
    before = desk.service.controller.locomotion
    sent = desk.state(stamp + 10 + gap_ms, resets=resets)
    assert desk.service.controller.locomotion is not before
    (reply,) = _of(sent, GaitReply)
    assert (reply.request_id, reply.outcome) == (7, GaitOutcome.ABORTED)
    assert reply.reason == reason
    (report,) = _of(sent, ControllerState)
    assert (report.state, report.gait) == (ControlState.STAND, Gait.NONE)
    # And only once.
    after = desk.service.controller.locomotion
    desk.state(stamp + 20 + gap_ms, resets=resets)
    assert desk.service.controller.locomotion is after


def test_a_short_gap_is_no_restart() -> None:
    desk = Desk()
    stamp = desk.stand()
    before = desk.service.controller.locomotion
    desk.state(stamp + LONGEST_GAP_NS // MS)
    assert desk.service.controller.locomotion is before


def test_counts_survive_a_restart_of_the_controller() -> None:
    desk = Desk()
    desk.state(1000)
    desk.service.controller.unsolved = 3
    desk.service.controller.locomotion.completed = 2
    (report,) = _of(desk.state(1010, resets=1), ControllerState)
    assert (report.unsolved, report.gaits_completed) == (3, 2)


def test_the_first_state_ever_is_no_reset() -> None:
    desk = Desk()
    before = desk.service.controller.locomotion
    desk.state(1000, resets=4)
    desk.state(1010, resets=4)
    assert desk.service.controller.locomotion is before


def test_same_messages_same_bytes() -> None:
    """Live or replayed, two services fed alike answer alike to the last bit."""
    script: list[list[tuple[Topic[Any], Message]]] = []
    config = WbcConfig(stand_time=0.3)
    bench = Bench(config)

    def note(state: PlantState) -> None:
        script.append([(PLANT_STATE, state), (TELEOP_CLAIM, claim(len(script)))])

    bench.watch = note
    bench.run(0.4)
    bench.ask(Gait.TURN_LEFT)
    bench.run(1.0)
    for k in range(0, len(script), 5):
        goal = np.array([0.35 + 0.05 * np.sin(0.03 * k), 0.25, 0.1])
        script[k].append((TELEOP_SETPOINT, setpoint(left=goal)))
    script[40].append(_request(1, Gait.TURN_LEFT))
    transcripts: list[list[bytes]] = []
    for _ in range(2):
        desk = Desk(config)
        outputs = [output for messages in script for output in desk.step(*messages)]
        transcripts.append([encode(o.message, o.message.header) for o in outputs])
    one, other = transcripts
    assert len(one) == 2 * len(script) + 1
    assert one == other
