"""Several operators at one service: whom it follows, what it says, and what others are told."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from common.runtime.service import Output
from common.schemas import (
    AuthorityChange,
    AuthorityState,
    ControllerState,
    Gait,
    GaitOutcome,
    GaitReply,
    GuardMode,
    Message,
    OperatorKind,
    Sender,
    Setpoint,
)
from common.topics import (
    PLANT_STATE,
    TELEOP_CLAIM,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    Topic,
)
from services.wbc.config import WbcConfig
from services.wbc.service import REQUESTS_PER_TICK, WbcService
from tests.services.inputs import FakeInputs

from .bench import Bench
from .support import MS, claim, nominal_state, request, setpoint

SCRIPT, PERSON = Sender("teleop", 5), Sender("keyboard", 6)
KINDS = {SCRIPT: OperatorKind.SCRIPT, PERSON: OperatorKind.PERSON}
BOOT = 77


class Desk:
    """A service in front of a script that has the robot and a person, in a nominal crouch."""

    def __init__(self) -> None:
        self.service = WbcService(WbcConfig(solver="daqp", stand_time=0.3))
        self.service.boot = BOOT
        self.inputs = FakeInputs()
        self.now = 1000
        self.acts = {SCRIPT: 1, PERSON: 0}
        self.state: dict[str, Any] = {}
        self.sent: list[Message] = []

    def tick(self, *messages: tuple[Topic[Any], Message], ticks: int = 1) -> "Desk":
        self.sent = []
        for n in range(ticks):
            self.now += 10
            self.inputs.begin_step()
            state = nominal_state(self.now * MS).model_copy(update=self.state)
            self.inputs.put(PLANT_STATE, state)
            for sender, act in self.acts.items():
                holding = sender is SCRIPT and act == 1
                said = claim(
                    self.now, sender, KINDS[sender], wants=act > 0, act=act, holding=holding
                )
                self.inputs.put(TELEOP_CLAIM, said)
            for topic, message in messages if n == 0 else ():
                self.inputs.put(topic, message)
            outputs: Sequence[Output] = self.service.step(self.inputs, 0)
            self.sent += [output.message for output in outputs]
        return self

    def of(self, kind: type[Any]) -> list[Any]:
        return [message for message in self.sent if isinstance(message, kind)]

    def stand(self) -> "Desk":
        return self.tick(ticks=33)

    def ask(self, request_id: int, sender: Sender, **fields: int) -> GaitReply:
        self.tick((TELEOP_GAIT, request(request_id, Gait.FORWARD, sender, **fields)))
        (reply,) = self.of(GaitReply)
        assert isinstance(reply, GaitReply)
        return reply

    def hands(self, sender: Sender, x: float) -> Any:
        """A set-point of both hands at a distance ahead of the body [m]."""
        left, right = np.array([x, 0.25, 0.1]), np.array([x, -0.25, 0.1])
        return TELEOP_SETPOINT, setpoint(left, right, sender=sender)


def test_it_follows_the_one_that_has_the_robot_and_counts_the_others() -> None:
    desk = Desk().tick()
    before = desk.service.controller.target.positions
    desk.tick(desk.hands(PERSON, 0.5))
    assert np.array_equal(desk.service.controller.target.positions, before)
    for _ in range(22):
        desk.tick(desk.hands(SCRIPT, 0.4), desk.hands(PERSON, 0.5), ticks=5)
    assert desk.service.controller.target.positions[:, 0] == pytest.approx([0.4, 0.4])
    (state,) = desk.tick(ticks=10).of(AuthorityState)
    assert (state.holder, state.holder_boot, state.kind) == (*SCRIPT, OperatorKind.SCRIPT)
    assert state.ignored == 1 + 22


def test_a_change_is_said_at_once_and_the_state_ten_times_a_second() -> None:
    desk = Desk()
    (first,) = desk.tick().of(AuthorityState)
    assert (first.change, first.holder) == (AuthorityChange.RESUMED, "teleop")
    assert len(desk.tick(ticks=100).of(AuthorityState)) == 10
    desk.tick(ticks=3)
    desk.acts[PERSON] = 1
    (change,) = desk.tick().of(AuthorityState)
    assert (change.change, change.holder) == (AuthorityChange.TAKEN, "keyboard")
    assert change.header.stamp == change.since == desk.now * MS
    # Two changes in one tick are two messages.
    desk.acts[PERSON] = 0
    changes = [state.change for state in desk.tick().of(AuthorityState)]
    assert changes == [AuthorityChange.RELEASED, AuthorityChange.GRANTED]


def test_a_hand_over_moves_the_target_steadily_to_the_new_operator_s() -> None:
    desk = Desk().tick()
    for _ in range(30):
        desk.tick(desk.hands(SCRIPT, 0.25), ticks=5)
    desk.acts[PERSON] = 1
    places = [0.25]
    for _ in range(50):
        desk.tick(desk.hands(SCRIPT, 0.25), desk.hands(PERSON, 0.55), ticks=5)
        places.append(float(desk.service.controller.target.positions[0, 0]))
    steps = np.diff(places)
    # 0.3 m at a mean speed of 0.25 m/s; the peak of minimum jerk is 1.875 times the mean.
    assert steps.max() == pytest.approx(0.05 * 0.25 * 1.875, rel=0.02)
    assert steps.min() >= 0.0
    assert steps[0] == pytest.approx(0.0, abs=1e-12)
    assert places[-1] == pytest.approx(0.55)
    assert np.flatnonzero(np.array(places) > 0.55 - 1e-9)[0] == 25


def test_who_begins_at_the_published_target_is_followed_at_once() -> None:
    desk = Desk().tick()
    desk.tick(desk.hands(SCRIPT, 0.25), ticks=150)
    (*_, target) = desk.tick(ticks=5).of(Setpoint)
    desk.acts[PERSON] = 1
    sender = {"header": target.header.model_copy(update=PERSON._asdict())}
    desk.tick((TELEOP_SETPOINT, target.model_copy(update=sender)), ticks=5)
    desk.tick(desk.hands(PERSON, 0.5))
    assert desk.service.controller.target.positions[0, 0] == pytest.approx(0.5)


def test_the_target_is_published_twenty_times_a_second() -> None:
    desk = Desk().tick()
    desk.tick(desk.hands(SCRIPT, 0.35), ticks=100)
    desk.tick(desk.hands(SCRIPT, 0.35), ticks=100)
    targets = desk.of(Setpoint)
    assert len(targets) == 20
    assert np.diff([t.header.stamp for t in targets]).tolist() == [50 * MS] * 19
    assert targets[-1].left_hand_position_in_body == pytest.approx([0.35, 0.25, 0.1])


def test_the_freshness_of_setpoints_is_the_holder_s() -> None:
    desk = Desk().tick()
    _, message = desk.hands(SCRIPT, 0.3)
    stamped = message.model_copy(
        update={"header": message.header.model_copy(update={"stamp": 900 * MS})}
    )
    (state,) = desk.tick((TELEOP_SETPOINT, stamped)).of(ControllerState)
    assert (state.setpoint_fresh, state.setpoint_stamp) == (True, 900 * MS)
    desk.tick(ticks=30)
    (state,) = desk.tick(desk.hands(PERSON, 0.3)).of(ControllerState)
    assert (state.setpoint_fresh, state.setpoint_stamp) == (False, 900 * MS)
    desk.acts[PERSON] = 1
    (state,) = desk.tick().of(ControllerState)
    assert (state.setpoint_fresh, state.setpoint_stamp) == (False, 0)


def test_a_setpoint_from_before_the_hand_over_is_not_applied_after_it() -> None:
    desk = Desk().tick()
    desk.tick(desk.hands(PERSON, 0.5))
    before = desk.service.controller.target.positions
    desk.acts[PERSON] = 1
    desk.tick(ticks=5)
    assert np.array_equal(desk.service.controller.target.positions, before)


def test_a_gait_of_another_is_refused_with_who_has_the_robot() -> None:
    desk = Desk().stand()
    reply = desk.ask(4, PERSON)
    assert reply.outcome is GaitOutcome.REFUSED
    assert "teleop has the robot" in reply.reason
    assert reply.requester_boot == PERSON.boot
    assert desk.ask(4, SCRIPT).outcome is GaitOutcome.ACCEPTED
    # The gait goes on under the next operator; only its requester is told of its end.
    desk.acts[PERSON] = 1
    (end,) = desk.tick(ticks=345).of(GaitReply)
    assert (end.outcome, end.requester_boot) == (GaitOutcome.COMPLETED, SCRIPT.boot)
    desk.acts = {SCRIPT: 0, PERSON: 0}
    assert "nobody has the robot" in desk.tick(ticks=5).ask(5, SCRIPT).reason


@pytest.mark.parametrize(
    ("state", "words"),
    [
        ({"guard": GuardMode.ESTOP}, "emergency stop"),
        ({"guard": GuardMode.DAMP, "fallen": True}, "fallen"),
        ({"guard": GuardMode.HOLD}, "holds the robot"),
    ],
)
def test_a_robot_that_does_not_obey_completes_no_gait_and_begins_none(
    state: dict[str, Any], words: str
) -> None:
    desk = Desk().stand()
    assert desk.ask(1, SCRIPT).outcome is GaitOutcome.ACCEPTED
    desk.tick(ticks=100)
    desk.state = state
    (reply,) = desk.tick(ticks=10).of(GaitReply)
    assert reply.outcome is GaitOutcome.ABORTED
    assert words in reply.reason
    desk.tick(ticks=500)
    assert desk.of(GaitReply) == []
    reports = desk.of(ControllerState)
    assert {report.gait for report in reports} == {Gait.NONE}
    assert words in reports[-1].obstacle
    refused = desk.ask(2, SCRIPT)
    assert refused.outcome is GaitOutcome.REFUSED
    assert words in refused.reason or "nobody has the robot" in refused.reason


def test_a_stop_that_is_over_before_the_next_state_takes_the_robot_away_all_the_same() -> None:
    desk = Desk().stand()
    # The holder and whoever waits go on asking, as a policy does: nobody gets it by itself.
    desk.state = {"stops": 1}
    (change,) = desk.tick().of(AuthorityState)
    assert (change.change, change.holder) == (AuthorityChange.STOPPED, "")
    assert all(state.holder == "" for state in desk.tick(ticks=200).of(AuthorityState))
    desk.acts[PERSON] = 1
    assert desk.tick().of(AuthorityState)[-1].holder == "keyboard"


def test_while_another_controller_has_the_plant_that_one_answers() -> None:
    desk = Desk().stand()
    desk.ask(1, SCRIPT)
    desk.state = {"controller_boot": BOOT + 1}
    (reply,) = desk.tick().of(GaitReply)
    assert reply.outcome is GaitOutcome.ABORTED
    assert "another controller" in reply.reason
    desk.tick((TELEOP_GAIT, request(2, Gait.FORWARD, SCRIPT)), ticks=20)
    assert desk.of(GaitReply) == []
    assert "another controller" in desk.of(ControllerState)[-1].obstacle
    # Repeated, what it aborted itself is answered by it.
    assert desk.ask(1, SCRIPT).outcome is GaitOutcome.ABORTED
    desk.state = {"controller_boot": BOOT}
    assert desk.stand().ask(3, SCRIPT).outcome is GaitOutcome.ACCEPTED


def test_a_request_to_an_earlier_controller_is_answered_that_it_was_restarted() -> None:
    desk = Desk().stand()
    reply = desk.ask(1, SCRIPT, controller_boot=BOOT - 1)
    assert reply.outcome is GaitOutcome.ABORTED
    assert "restarted" in reply.reason
    assert desk.ask(2, SCRIPT, controller_boot=BOOT).outcome is GaitOutcome.ACCEPTED


def test_a_thousand_requests_at_once_are_all_answered() -> None:
    desk = Desk().stand()
    requests = [(TELEOP_GAIT, request(n, Gait.FORWARD, SCRIPT)) for n in range(1000)]
    replies = desk.tick(*requests).of(GaitReply)
    assert len(replies) == REQUESTS_PER_TICK
    for _ in range(1000 // REQUESTS_PER_TICK - 1):
        replies += desk.tick().of(GaitReply)
    assert sorted(reply.request_id for reply in replies) == list(range(1000))
    assert [reply.outcome for reply in replies].count(GaitOutcome.ACCEPTED) == 1


def test_the_robot_stands_while_nobody_has_it_and_holds_its_hands() -> None:
    """In physics: hands on their way when the operator gives the robot back come to rest."""
    bench = Bench(WbcConfig(solver="daqp", stand_time=0.3))
    bench.run(0.6)
    for k in range(40):
        bench.send(setpoint(left=np.array([0.3 + 0.004 * k, 0.25, 0.1])))
        bench.run(0.05)
    bench.claims = False
    bench.run(2.0)
    state = bench.states[-1]
    assert not state.setpoint_fresh
    assert state.hand_position_error.max() < 0.01
    assert bench.commands[-1].position == pytest.approx(bench.commands[-30].position, abs=0.01)
    assert not bench.plant.fallen
