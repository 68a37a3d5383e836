"""The judge alone, on a task made for the purpose."""

from typing import Any

import pytest

from common.schemas import TaskVerdict
from services.sim.tasks.base import (
    BodyState,
    Contact,
    FailureCondition,
    Snapshot,
    Stage,
    Start,
    Task,
    contact_pairs,
)
from services.sim.tasks.judge import Judge

from .support import snapshot

ELBOW = Contact("left", "elbow", "jamb")
HAND = Contact("left", "finger", "lever")


def value(name: str) -> Any:
    return lambda now: now.joints.get(name, 0.0) > 0.5


TASK = Task(
    name="toy/toy",
    scene="flat",
    goal="",
    rule="",
    limit=2.0,
    start=lambda _rng: Start(0.0, 0.0, 0.0),
    stages=(
        Stage("begun", value("begun")),
        Stage("half", value("half"), partial=True),
        Stage("done", value("done"), hold=0.5, after="half"),
    ),
    failures=(FailureCondition("it broke", value("broken"), hold=0.1),),
    desired=contact_pairs(("finger",), "lever"),
    marks={"goal": BodyState.upright(0.0, 0.0)},
)


def run(judge: Judge, start: float, end: float, **changes: Any) -> TaskVerdict:
    """Tick at 100 Hz from ``start`` to ``end`` [s] with the same picture of the world."""
    for i in range(round(start * 100), round(end * 100) + 1):
        judge.tick(snapshot(i / 100, **changes))
    return judge.verdict


def both(now: float = 1.0) -> dict[str, float]:
    return {"half": 1.0, "done": now}


def test_success_needs_the_goal_for_as_long_as_it_must_hold() -> None:
    judge = Judge(TASK)
    assert run(judge, 0.0, 0.45, joints=both()) is TaskVerdict.RUNNING
    assert run(judge, 0.46, 0.50, joints=both()) is TaskVerdict.SUCCESS
    assert judge.reason == "done in 0.5 s"


def test_an_interruption_starts_the_hold_again() -> None:
    judge = Judge(TASK)
    run(judge, 0.0, 0.45, joints=both())
    run(judge, 0.46, 0.46, joints=both(0.0))
    assert run(judge, 0.47, 0.90, joints=both()) is TaskVerdict.RUNNING
    assert run(judge, 0.91, 0.98, joints=both()) is TaskVerdict.SUCCESS


def test_a_stage_waits_for_the_one_before_it() -> None:
    judge = Judge(TASK)
    assert run(judge, 0.0, 1.0, joints={"done": 1.0}) is TaskVerdict.RUNNING
    assert judge.done == {}


def test_the_goal_with_an_undesired_contact_is_a_partial_success_that_names_it() -> None:
    judge = Judge(TASK)
    run(judge, 0.0, 0.1, joints=both(), contacts={ELBOW: 3.0, HAND: 20.0})
    run(judge, 0.11, 0.2, joints=both(), contacts={ELBOW: 44.0})
    assert run(judge, 0.21, 1.0, joints=both()) is TaskVerdict.PARTIAL
    assert judge.reason == "the goal was reached, but with left elbow on jamb"
    assert list(judge.undesired) == [ELBOW]
    assert (judge.undesired[ELBOW].since, judge.undesired[ELBOW].peak) == (0.0, 44.0)


def test_a_brush_is_no_collision_and_things_may_touch_each_other() -> None:
    judge = Judge(TASK)
    contacts = {ELBOW: 0.9, Contact("", "hammer", "cart tray"): 50.0}
    assert run(judge, 0.0, 1.0, joints=both(), contacts=contacts) is TaskVerdict.SUCCESS


def test_time_out() -> None:
    judge = Judge(TASK)
    assert run(judge, 0.0, 1.99, joints={"begun": 1.0}) is TaskVerdict.RUNNING
    assert run(judge, 2.0, 2.0) is TaskVerdict.FAILURE
    assert judge.reason == "not within 2 s: half, done"


def test_time_out_with_part_of_the_task_done_says_which() -> None:
    judge = Judge(TASK)
    run(judge, 0.0, 0.5, joints={"half": 1.0})
    assert run(judge, 0.51, 2.0) is TaskVerdict.PARTIAL
    assert judge.reason == "only half; not within 2 s: begun, done"


def test_a_fall_fails_even_at_the_goal() -> None:
    judge = Judge(TASK)
    run(judge, 0.0, 0.49, joints=both())
    assert run(judge, 0.5, 0.5, joints=both(), fallen=True) is TaskVerdict.FAILURE
    assert judge.reason == "the robot fell"


def test_what_cannot_be_mended_fails_after_its_time() -> None:
    judge = Judge(TASK)
    assert run(judge, 0.0, 0.09, joints={"broken": 1.0}) is TaskVerdict.RUNNING
    assert run(judge, 0.1, 0.1, joints={"broken": 1.0}) is TaskVerdict.FAILURE
    assert judge.reason == "it broke"


@pytest.mark.parametrize("then", [{"fallen": True}, {"joints": {"broken": 1.0}}, {}])
def test_a_verdict_is_final(then: dict[str, Any]) -> None:
    judge = Judge(TASK)
    run(judge, 0.0, 0.5, joints=both())
    time = judge.time
    assert run(judge, 0.6, 3.0, **then) is TaskVerdict.SUCCESS
    assert judge.time == time


def test_a_snapshot_knows_who_touches_what() -> None:
    now: Snapshot = snapshot(0.0, contacts={HAND: 5.0, Contact("", "hammer", "table"): 1.0})
    assert now.touched("lever")
    assert now.touched("lever", "finger", side="left")
    assert not now.touched("lever", side="right")
    assert not now.touched("lever", "wrist")
    assert now.touched("table", "hammer")
    assert now.touched("hammer", "table")
    assert not now.touched("hammer"), "a table is no part of the robot"
