"""A log in which the robot changes hands replays to the same bytes."""

from itertools import pairwise
from pathlib import Path

from common.schemas import AuthorityState, OperatorClaim, OperatorKind
from common.topics import TELEOP_CLAIM, TELEOP_GAIT, TELEOP_SETPOINT, WBC_AUTHORITY
from lab.logs.replay_check import Checker, CheckOptions, runs_in
from tests.golden.make import save, scenario
from tests.services.wbc.support import request, setpoint
from verification.walking.stack import Stack


def test_a_log_of_two_operators_replays_to_the_same_bytes(tmp_path: Path) -> None:
    """A person takes the robot from a script in a gait, and gives it back."""
    stack = Stack(scenario(), record=True)
    states: list[AuthorityState] = []
    stack.runner.on_message(WBC_AUTHORITY, states.append)
    stack.runner.run_for(1.4)
    for tick in range(20):
        wants = tick < 15
        claim = OperatorClaim(kind=OperatorKind.PERSON, wants=wants, act=1, holding=False)
        stack.runner.inject(TELEOP_CLAIM, claim, "keyboard")
        stack.runner.inject(TELEOP_SETPOINT, setpoint(), "keyboard")
        stack.runner.inject(TELEOP_GAIT, request(tick), "keyboard")
        stack.runner.run_for(0.05)
    holders = [state.holder for state in states]
    changes = [new for old, new in pairwise(holders) if old != new]
    assert changes == ["keyboard", "", "teleop"]
    save(stack, tmp_path / "log.mcap")
    (run,) = runs_in(tmp_path / "log.mcap")
    report = Checker(tmp_path / "log.mcap", CheckOptions()).check(run, lambda *_: None)
    assert report.stopped == ""
    assert report.identical
    assert report.outputs["wbc/authority"].compared > 20
    assert report.outputs["wbc/command"].compared > 200
