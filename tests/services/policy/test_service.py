"""The policy as a service in simulated time: it moves the hands, starves, walks, hands over."""

from pathlib import Path

import numpy as np
import pytest

from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import (
    OperatorClaim,
    OperatorKind,
    PolicyMode,
)
from common.topics import (
    TELEOP_CLAIM,
    TELEOP_SETPOINT,
)
from services.policy.service import PolicyConfig, PolicyOperator
from services.sim.config import SimConfig
from services.sim.service import PlantService
from services.wbc.config import wbc_config
from services.wbc.service import WbcService
from tests.common.runtime.replaying import recorded, replay
from tests.services.policy.served import (
    BLIND,
    made_policy,
    reaching,
    saved,
)
from tests.services.policy.stack import Stack, modes

MODE = PolicyMode


def test_it_gets_the_free_robot_begins_at_its_target_and_drives_the_hands() -> None:
    stack = Stack(made_policy()[0])
    stack.run(6.0)
    assert stack.authority.holder == "policy"
    assert stack.authority.kind is OperatorKind.POLICY
    assert max(stack.errors(40)) < 1e-6
    assert all(s.gripper_closure.tolist() == [1.0, 0.0] for s in stack.setpoints[-40:])
    assert modes(stack) == [MODE.WAITING, MODE.OK]
    # Five steps of twenty, then the next one; twenty frames from an empty memory each.
    steps = [request.step for request in stack.engine.requests]
    assert set(np.diff(steps)) == {5}
    assert stack.engine.requests[-1].observations.shape == (
        20,
        stack.engine.requests[-1].observations.shape[1],
    )
    assert not stack.engine.requests[-1].memory.any()
    assert stack.policy.note == "acting"


@pytest.mark.parametrize("delay", [0, 1, 3, 8])
def test_answers_are_aligned_by_the_step_however_late_they_come(delay: int) -> None:
    stack = Stack(made_policy(delay)[0])
    stack.run(6.0)
    assert max(stack.errors(40)) < 1e-6
    assert stack.states[-1].round_trip == pytest.approx(0.05 * delay)
    assert stack.states[-1].late == 0


def test_an_answer_of_which_nothing_is_left_is_dropped_and_the_hands_hold() -> None:
    stack = Stack(made_policy(25, answer_timeout=3.0)[0])
    stack.run(8.0)
    last = stack.states[-1]
    assert last.late > 2
    assert last.answers == last.late
    assert modes(stack)[-1] in {MODE.STARVED, MODE.DEGRADED}
    held = [s.left_hand_position_in_body[0] for s in stack.setpoints]
    assert np.ptp(held) == 0.0


def test_it_measures_the_delay_of_its_links_and_skips_as_many_steps() -> None:
    for links, steps in (({}, 0), ({"command": "250ms"}, 5), ({"feedback": "100ms"}, 2)):
        stack = Stack(made_policy()[0], **links)
        stack.run(7.0)
        last = stack.states[-1]
        assert last.compensated == steps
        assert last.delay == pytest.approx(0.05 * steps, abs=0.025)
        expected = [
            reaching(step + steps)[0] for step in range(stack.policy.steps - 20, stack.policy.steps)
        ]
        got = [s.left_hand_position_in_body[0] for s in stack.setpoints[-20:]]
        np.testing.assert_allclose(got, expected, atol=1e-6)


def test_without_answers_the_hands_hold_and_go_on_when_they_come_again() -> None:
    policy, engine = made_policy()
    stack = Stack(policy)
    stack.run(5.0)
    engine.silent = True
    stack.run(4.0)
    assert stack.mode() is MODE.RECONNECTING
    assert "no answer" in stack.policy.note
    held = [s.left_hand_position_in_body[0] for s in stack.setpoints[-30:]]
    assert np.ptp(held) == 0.0
    assert stack.states[-1].unanswered >= 2
    engine.silent = False
    stack.run(3.0)
    assert stack.mode() is MODE.OK
    assert max(stack.errors(20)) < 1e-6
    assert MODE.DEGRADED in modes(stack)
    assert not stack.fallen
    assert stack.authority.changes == 1


def test_where_nobody_answers_it_asks_in_every_step() -> None:
    policy, engine = made_policy()
    engine.silent, engine.waiting, engine.problem = True, False, "no server"
    stack = Stack(policy)
    stack.run(4.0)
    assert stack.mode() is MODE.RECONNECTING
    assert policy.note == "reconnecting: no server"
    assert set(np.diff([request.step for request in engine.requests])) == {1}
    engine.silent, engine.waiting = False, True
    # The last of these requests stays open until its time is over.
    stack.run(1.3)
    assert stack.mode() is MODE.OK


def test_a_person_takes_the_robot_and_gives_it_back() -> None:
    policy, engine = made_policy()
    stack = Stack(policy)
    stack.run(4.0)
    claim = OperatorClaim(kind=OperatorKind.PERSON, wants=True, act=1, holding=False)
    for act in range(10):
        stack.runner.inject(
            TELEOP_CLAIM, claim.model_copy(update={"act": 1 + (act == 0)}), "person"
        )
        stack.run(0.1)
    assert stack.authority.holder == "person"
    assert stack.mode() is MODE.WAITING
    assert policy.note == "waiting: person has the robot"
    asked, sent = len(engine.requests), len(stack.setpoints)
    stack.run(0.3)
    assert (len(engine.requests), len(stack.setpoints)) == (asked, sent)
    stack.runner.inject(TELEOP_CLAIM, claim.model_copy(update={"wants": False}), "person")
    stack.run(2.0)
    assert stack.authority.holder == "policy"
    # It has forgotten what it saw before.
    assert len(engine.requests[asked].observations) == 1
    assert stack.mode() is MODE.OK


def test_it_does_not_begin_in_time_and_says_why() -> None:
    policy, _ = made_policy(start_timeout=0.5)
    with SimTimeRunner([policy]) as runner:
        runner.run_for(1.0)
    assert policy.exit_code == 1
    assert "not begun within 0.5 s" in policy.failure
    assert "the controller has not said" in policy.failure
    waits, _ = made_policy(start_timeout=0.5, stay=True)
    with SimTimeRunner([waits]) as runner:
        runner.run_for(1.0)
    assert waits.exit_code is None
    assert not waits.failure


def test_without_the_robots_state_it_plays_its_plan_to_the_end_and_then_holds() -> None:
    policy, _ = made_policy()
    stack = Stack(policy)
    stack.run(4.0)
    stack.runner.set_link("plant/state", "0ms loss=100%", "policy")
    stack.run(0.6)
    assert stack.mode() is MODE.DEGRADED
    assert "no plant/state for" in policy.note
    stack.run(1.5)
    assert stack.mode() is MODE.STARVED
    assert np.ptp([s.left_hand_position_in_body[0] for s in stack.setpoints[-10:]]) == 0.0


def test_a_memory_that_goes_on_is_given_every_frame_once() -> None:
    policy, engine = made_policy(4, window=0)
    stack = Stack(policy)
    stack.run(4.0)
    assert engine.requests[0].memory.max() == 0.0
    seen = [len(request.observations) for request in engine.requests]
    steps = [request.step for request in engine.requests]
    assert seen[1:] == np.diff(steps).tolist()
    assert [request.memory.max() for request in engine.requests] == list(range(len(steps)))


def test_two_runs_are_the_same() -> None:
    said = []
    for _ in range(2):
        stack = Stack(made_policy(2)[0], command="normal(100ms, 40ms)")
        stack.run(3.0)
        said.append([s.left_hand_position_in_body.tolist() for s in stack.setpoints])
    assert said[0] == said[1]
    assert len(said[0]) > 20


def test_a_policy_on_torch_drives_the_hands_and_a_log_of_it_replays_to_the_same_bytes(
    tmp_path: Path,
) -> None:
    pytest.importorskip("torch")
    config = PolicyConfig(checkpoint=saved(tmp_path / "made", BLIND))
    plant, controller = PlantService(SimConfig(seed=3)), WbcService(wbc_config("relaxed", "fast"))
    runner = SimTimeRunner(
        [plant, controller, PolicyOperator(config)], seed=3, record=True, journal=True
    )
    runner.run_for(3.0)
    messages = recorded(runner)
    assert sum(message.topic is TELEOP_SETPOINT for message in messages) > 30
    report = replay(PolicyOperator.from_settings(config.model_dump(mode="json")), messages)
    assert report.stopped == ""
    assert report.identical
    assert report.outputs["teleop/setpoint"].compared > 30
