"""A script whose controller is killed in a gait is told what became of it, in simulated time."""

from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import AuthorityChange, AuthorityState, Gait, GaitOutcome, GaitReply
from common.topics import WBC_AUTHORITY, WBC_REPLY
from services.sim.config import SimConfig
from services.sim.service import PlantService
from services.teleop.scripted.script import Script, Walk
from services.teleop.scripted.service import ScriptedOperator
from services.wbc.service import WbcService


def test_a_gait_in_which_the_controller_is_killed_is_answered_by_the_next_one() -> None:
    plant, operator = (
        PlantService(SimConfig()),
        ScriptedOperator(Script(name="walk", steps=(Walk(gait=Gait.FORWARD),))),
    )
    replies: list[GaitReply] = []
    decisions: list[AuthorityState] = []
    with SimTimeRunner([plant, WbcService(), operator]) as runner:
        runner.on_message(WBC_REPLY, replies.append)
        runner.on_message(WBC_AUTHORITY, decisions.append)
        runner.run_for(2.5)
        assert [reply.outcome for reply in replies] == [GaitOutcome.ACCEPTED]
        runner.pause_service("wbc")
        runner.run_for(0.15)
        runner.replace_service("wbc", WbcService())
        runner.run_for(1.5)
    first, last = replies
    assert last.outcome is GaitOutcome.ABORTED
    assert "restarted" in last.reason
    assert (last.request_id, last.requester_boot) == (first.request_id, operator.boot)
    assert "restarted" in operator.failure
    assert not plant.plant.fallen
    # The next controller gave the robot back to the script at once.
    resumed = next(d for d in decisions if d.header.boot != decisions[0].header.boot and d.holder)
    assert (resumed.change, resumed.holder) == (AuthorityChange.RESUMED, "teleop")
