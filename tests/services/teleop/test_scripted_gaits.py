"""How a script asks for gaits, and what it makes of the answers."""

from collections.abc import Sequence

import numpy as np
import pytest

from common.schemas import ControllerState, ControlState, Gait, GaitOutcome, GaitRequest, Header
from common.topics import TELEOP_GAIT
from services.teleop.errors import ScriptError
from services.teleop.scripted.gaits import GaitClient
from services.teleop.scripted.script import Mark, Wait, Walk

from .scripts import bench, last_status, scripted
from .support import FakeController, controller_state

A, R, C, X = (GaitOutcome.ACCEPTED, GaitOutcome.REFUSED, GaitOutcome.COMPLETED, GaitOutcome.ABORTED)


def test_gaits_are_asked_for_one_after_another() -> None:
    b = bench(Walk(gait=Gait.FORWARD, count=2), Walk(gait=Gait.TURN_LEFT)).run(20)
    requests = b.controller.requests
    assert [r.gait for r in requests] == [Gait.FORWARD, Gait.FORWARD, Gait.TURN_LEFT]
    first = requests[0].request_id
    assert [r.request_id for r in requests] == [first, first + 1, first + 2]
    times = b.times(TELEOP_GAIT)
    assert np.diff(times).min() >= 1_000_000_000
    assert b.service.exit_code == 0


def test_request_ids_start_at_the_clock_so_a_later_operator_repeats_none() -> None:
    b = bench(Walk(gait=Gait.FORWARD)).run(5)
    assert b.controller.requests[0].request_id == 7050


def test_a_refused_gait_is_asked_for_again_after_a_pause_with_a_new_id() -> None:
    def answer(_request: GaitRequest, number: int) -> Sequence[GaitOutcome]:
        return [R] if number < 3 else [A, C]

    b = bench(Walk(gait=Gait.BACKWARD), controller=FakeController(answer=answer)).run(20)
    ids = [r.request_id for r in b.controller.requests]
    assert ids == [ids[0] + i for i in range(4)]
    assert np.diff(b.times(TELEOP_GAIT)).min() >= 500_000_000
    assert b.service.exit_code == 0


def test_a_gait_refused_too_often_fails_the_script_with_the_reason() -> None:
    b = bench(
        Mark(label="go"), Walk(gait=Gait.BACKWARD), controller=FakeController(answer=lambda *_: [R])
    ).run(30)
    assert len(b.controller.requests) == 10
    assert b.service.exit_code == 1
    expected = "step 2/2 (go): backward was refused 10 times: because"
    assert scripted(b).failure == expected
    assert last_status(b).failed == expected
    assert last_status(b).finished


def test_an_unanswered_request_is_sent_again_with_the_same_id() -> None:
    def answer(_request: GaitRequest, number: int) -> Sequence[GaitOutcome]:
        return [] if number < 2 else [A, C]

    b = bench(Walk(gait=Gait.FORWARD), controller=FakeController(answer=answer)).run(20)
    assert len({r.request_id for r in b.controller.requests}) == 1
    assert np.diff(b.times(TELEOP_GAIT)).min() == pytest.approx(2e9, abs=6e7)
    assert b.service.exit_code == 0


def test_a_request_never_answered_fails_the_script() -> None:
    silent = FakeController(answer=lambda *_: [])
    b = bench(Walk(gait=Gait.FORWARD), controller=silent).run(30)
    assert len(b.controller.requests) == 4
    assert b.service.exit_code == 1
    assert "forward was asked for 4 times, 2 s apart, without an answer" in scripted(b).failure


def test_lost_replies_are_made_up_for_by_the_state_and_the_gait_is_not_repeated() -> None:
    b = bench(
        Walk(gait=Gait.FORWARD, count=2), controller=FakeController(mute=True, gait_seconds=3.0)
    ).run(30)
    assert [r.gait for r in b.controller.requests] == [Gait.FORWARD] * 2
    assert b.controller.requests[0].request_id != b.controller.requests[1].request_id
    assert b.controller.completed == 2
    assert b.service.exit_code == 0


def test_lost_replies_of_a_gait_shorter_than_the_timeout_do_not_repeat_it() -> None:
    b = bench(Walk(gait=Gait.FORWARD), controller=FakeController(mute=True)).run(30)
    assert len(b.controller.requests) == 1
    assert b.service.exit_code == 0


def test_a_refusal_of_a_second_copy_is_no_refusal() -> None:
    def answer(_request: GaitRequest, number: int) -> Sequence[GaitOutcome]:
        return [A, C]

    b = bench(Walk(gait=Gait.FORWARD), controller=FakeController(answer=answer))
    b.run(0.3)
    request = b.controller.requests[0]
    b.inputs.queues["wbc/reply"] = [FakeController._reply(request, R)]
    b.run(10)
    assert len(b.controller.requests) == 1
    assert b.service.exit_code == 0


def test_an_aborted_gait_fails_the_script() -> None:
    aborting = FakeController(answer=lambda *_: [A, X])
    b = bench(Walk(gait=Gait.FORWARD), Wait(seconds=9), controller=aborting).run(30)
    assert b.service.exit_code == 1
    assert scripted(b).failure == "step 1/2: forward was aborted: because"


def test_a_gait_that_does_not_end_fails_the_script() -> None:
    b = bench(Walk(gait=Gait.FORWARD), controller=FakeController(gait_seconds=99.0)).run(60)
    assert b.service.exit_code == 1
    assert "accepted but not completed within 30 s" in scripted(b).failure


def test_a_restarted_controller_is_asked_what_became_of_the_gait() -> None:
    """The first run accepts and dies; the second answers the same request once it hears it."""

    def seen(boot: int, completed: int) -> ControllerState:
        state = controller_state(ControlState.BALANCE, Gait.NONE, completed)
        return state.model_copy(update={"header": Header(boot=boot)})

    client = GaitClient(next_id=5)
    client.update(0.05, (), seen(1, 7))
    walk = client.perform(Gait.FORWARD)
    next(walk)
    (request,) = client.outbox
    assert (request.request_id, request.controller_boot) == (5, 1)
    client.outbox.clear()
    client.update(0.05, [FakeController._reply(request, A)], seen(1, 7))
    next(walk)
    for _ in range(20):
        client.update(0.05, (), None)
        next(walk)
    assert client.outbox == []
    client.update(0.05, (), seen(2, 0))
    next(walk)
    assert client.outbox == [request]
    client.update(0.05, [FakeController._reply(request, X)], seen(2, 0))
    with pytest.raises(ScriptError, match="aborted"):
        next(walk)
    # The next gait is asked of the new run, whose count begins again.
    walk = client.perform(Gait.FORWARD)
    next(walk)
    assert client.outbox[-1].controller_boot == 2
    assert client.completed == 0


def test_a_restarted_controller_that_never_answers_fails_the_script_in_words() -> None:
    client = GaitClient()
    states = [
        controller_state().model_copy(update={"header": Header(boot=boot)}) for boot in (1, 2)
    ]
    client.update(0.05, (), states[0])
    walk = client.perform(Gait.FORWARD)
    next(walk)
    client.update(0.05, [FakeController._reply(client.outbox[0], A)], states[0])

    def wait() -> None:
        for _ in walk:
            client.update(0.05, (), states[1])

    with pytest.raises(ScriptError, match="without an answer"):
        wait()
