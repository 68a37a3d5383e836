"""When a policy asks for gaits: as an event, once, in balance; and what a restart does to one."""

from typing import Any

import numpy as np
import pytest

from common.schemas import (
    ControllerState,
    ControlState,
    Gait,
    GaitOutcome,
    GaitReply,
    GaitRequest,
    Header,
)
from common.topics import (
    WBC_REPLY,
    WBC_TARGET,
)
from services.policy.serving.config import TriggerConfig
from services.policy.serving.gait_trigger import GaitTrigger
from tests.common.transport.support import example_of
from tests.services.policy.served import (
    gait_of,
    made_policy,
)
from tests.services.policy.stack import Stack


def controller(*, walking: bool = False, boot: int = 7) -> ControllerState:
    return example_of(ControllerState).model_copy(
        update={
            "header": Header(boot=boot),
            "state": ControlState.RF_SWING if walking else ControlState.BALANCE,
            "gait": Gait.FORWARD if walking else Gait.NONE,
        }
    )


def reply(request: GaitRequest, outcome: GaitOutcome) -> GaitReply:
    return GaitReply(request_id=request.request_id, gait=request.gait, outcome=outcome)


class Steps:
    """A trigger of a policy that was taught 8 frames before a request, stepped at 20 Hz."""

    def __init__(self, **config: Any) -> None:
        self.trigger = GaitTrigger(TriggerConfig(**config), hazard_frames=8, period=0.05)
        self.step = 100
        self.trigger.begin(self.step + 1, first_id=5)

    def run(
        self,
        steps: int,
        probability: float = 0.0,
        *replies: GaitReply,
        walking: bool = False,
        late: int = 0,
    ) -> GaitRequest | None:
        """Step until something is requested; answers see what was there ``late`` steps ago."""
        for index in range(steps):
            self.step += 1
            heard = replies if index == 0 else ()
            self.trigger.update(self.step, controller(walking=walking), heard)
            given = gait_of(Gait.TURN_LEFT, probability)
            if (request := self.trigger.decide(given, self.step - late)) is not None:
                return request
        return None


def test_the_probability_gathers_over_the_frames_in_balance() -> None:
    steps = Steps(level=0.7, hold_off=0.0)
    request = steps.run(20, 0.5)
    assert request is not None
    assert (request.gait, request.request_id, request.controller_boot) == (Gait.TURN_LEFT, 5, 7)
    # 0.7 of 8 frames are 5.6; half of that in each frame.
    assert steps.step == 100 + 12
    assert Steps().run(120, 0.05) is not None
    assert Steps().run(110, 0.05) is None


def test_what_gathered_before_a_gait_is_forgotten() -> None:
    steps = Steps(hold_off=0.0)
    assert steps.run(10, 0.5) is None
    assert steps.run(3, 0.5, walking=True) is None
    assert steps.run(11, 0.5) is None
    assert steps.run(1, 0.5) is not None


def test_nothing_is_requested_while_a_request_is_open_or_held_off() -> None:
    steps = Steps(hold_off=0.5, patience=2.0)
    first = steps.run(20, 1.0)
    assert first is not None
    assert steps.run(10, 1.0, reply(first, GaitOutcome.ACCEPTED)) is None
    assert steps.run(40, 1.0, walking=True) is None
    # After its end ten steps are held off, and six are needed.
    assert steps.run(15, 1.0, reply(first, GaitOutcome.COMPLETED)) is None
    second = steps.run(1, 1.0)
    assert second is not None
    assert second.request_id == 6


@pytest.mark.parametrize("outcome", [GaitOutcome.REFUSED, GaitOutcome.ABORTED])
def test_a_refused_or_aborted_request_may_be_followed_by_another(outcome: GaitOutcome) -> None:
    steps = Steps(hold_off=0.1)
    first = steps.run(20, 1.0)
    assert first is not None
    assert steps.run(7, 1.0, reply(first, outcome)) is None
    assert steps.run(1, 1.0) is not None


def test_a_request_of_which_nothing_is_heard_is_given_up() -> None:
    steps = Steps(hold_off=0.0, patience=2.0)
    assert steps.run(20, 1.0) is not None
    assert steps.run(40, 1.0) is None
    assert steps.run(10, 1.0) is not None


def test_what_was_seen_before_the_end_of_a_gait_does_not_repeat_it() -> None:
    steps = Steps(hold_off=0.0)
    first = steps.run(30, 1.0, late=10)
    assert first is not None
    steps.run(40, 1.0, reply(first, GaitOutcome.ACCEPTED), walking=True, late=10)
    # The answers of the next ten steps saw the robot before or in its gait.
    assert steps.run(10, 1.0, reply(first, GaitOutcome.COMPLETED), late=10) is None
    assert steps.run(5, 1.0, late=10) is None
    assert steps.run(1, 1.0, late=10) is not None


def test_as_a_threshold_the_probability_of_one_frame_counts() -> None:
    steps = Steps(rule="threshold", level=0.6)
    assert steps.run(200, 0.55) is None
    assert steps.run(1, 0.65) is not None


def test_a_gait_is_asked_for_once_when_enough_has_gathered_and_never_while_walking() -> None:
    policy, engine = made_policy(trigger={"hold_off": 1.0})
    engine.gait = lambda _request: gait_of(Gait.SIDE_LEFT, 0.8)
    stack = Stack(policy)
    stack.run(4.0)
    assert stack.states[-1].gaits == 1
    stack.run(12.0)
    replies: list[GaitReply] = stack.heard[WBC_REPLY.name]
    assert {reply.outcome for reply in replies} == {GaitOutcome.ACCEPTED, GaitOutcome.COMPLETED}
    assert set(stack.completed()) == {Gait.SIDE_LEFT}
    assert stack.states[-1].gaits - len(stack.completed()) in {0, 1}
    assert not stack.fallen


def test_restarted_while_it_walks_it_neither_falls_nor_jumps_nor_walks_twice() -> None:
    for at in (0.3, 1.2, 2.1):
        policy, engine = made_policy()
        engine.gait = lambda request: gait_of(Gait.FORWARD if request.step < 90 else Gait.NONE)
        stack = Stack(policy)
        while not stack.states or stack.states[-1].gaits == 0:
            stack.run(0.05)
        stack.run(at)
        stack.runner.pause_service("policy")
        stack.run(0.5)
        stack.policy, again = made_policy()
        stack.runner.replace_service("policy", stack.policy)
        stack.run(9.0)
        assert stack.completed() == [Gait.FORWARD], f"killed {at} s into the gait"
        assert again.requests
        assert not stack.fallen
        assert stack.authority.holder == "policy"
        # Its first set-points may be elsewhere; the controller's target goes there smoothly.
        targets = [t.left_hand_position_in_body for t in stack.heard[WBC_TARGET.name]]
        largest = np.linalg.norm(np.diff(targets, axis=0), axis=1).max()
        assert largest < 0.015
