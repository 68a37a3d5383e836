"""Verdicts on the live run of a scored task."""

from typing import Any

import pytest

from common.schemas import PlantStatus, TaskStatus, TaskVerdict
from deploy.process import Exit
from deploy.system import SystemOptions
from lab.live.demo import DemoOptions, ScriptJudge, _operator_and_judge
from lab.live.task_judge import AFTERMATH, VERDICT_TIMEOUT, TaskJudge
from lab.monitor.bus_stats import Snapshot
from tests.lab.review.synthetic import FakeRobot
from tests.lab.review.synthetic_task import operator, status

SUCCESS, PARTIAL, FAILURE = TaskVerdict.SUCCESS, TaskVerdict.PARTIAL, TaskVerdict.FAILURE


def view(
    task: TaskStatus | None, *, failed: str = "", fallen: bool = False, heard: bool = True
) -> Snapshot:
    robot = FakeRobot()
    plant, doing = robot.status(fallen=fallen)[1], operator(robot, failed=failed)[1]
    control = robot.wbc()[1]
    assert isinstance(plant, PlantStatus)
    values: dict[str, Any] = {"control": control if heard else None, "operator": doing}
    return Snapshot((), (), plant=plant, task=task, **values)


def task_status(
    verdict: TaskVerdict = TaskVerdict.RUNNING, done: int = 1, **changes: Any
) -> TaskStatus:
    message = status(FakeRobot(), done, verdict, time=12.3, **changes)[1]
    assert isinstance(message, TaskStatus)
    return message


def judge(seconds: float | None = None) -> TaskJudge:
    return TaskJudge("teleop", seconds, timeout=100.0)


@pytest.mark.parametrize(
    ("verdict", "fallen", "outcome"),
    [
        (SUCCESS, False, "completed"),
        (PARTIAL, False, "partial success"),
        (FAILURE, False, "task failed"),
        (FAILURE, True, "fell"),
    ],
)
def test_the_tasks_verdict_ends_the_run_after_a_moment(
    verdict: TaskVerdict, fallen: bool, outcome: str
) -> None:
    one, seen = judge(), view(task_status(verdict), fallen=fallen)
    assert one.verdict(5.0, view(task_status()), []) is None
    assert one.verdict(10.0, seen, []) is None
    ended = one.verdict(10.0 + AFTERMATH, seen, [])
    assert ended is not None
    assert ended.outcome == outcome
    assert ended.reason == f"door/unlock seed 7: it was a {verdict.name.lower()}"


def test_after_the_operators_end_the_judge_has_some_seconds() -> None:
    one, seen = judge(), view(task_status(), failed="the lever slipped")
    assert one.verdict(10.0, seen, []) is None
    assert one.verdict(10.0 + 0.9 * VERDICT_TIMEOUT, seen, []) is None
    ended = one.verdict(10.0 + VERDICT_TIMEOUT, seen, [])
    assert ended is not None
    assert ended.outcome == "task failed"
    assert ended.reason == (
        "the operator gave up: the lever slipped; no verdict at 12.3 s of the task, done: "
        "lever pressed"
    )
    two = judge()
    dead = [Exit("teleop", 2, expected=False, restarted=False, tail=("what?",))]
    assert two.verdict(3.0, view(None), dead) is None
    ended = two.verdict(3.0 + VERDICT_TIMEOUT, view(None), [])
    assert ended is not None
    assert "what?" in ended.reason
    assert "no task status" in ended.reason
    spoken = judge()
    assert spoken.verdict(10.0, seen, []) is None
    assert spoken.verdict(11.0, view(task_status(SUCCESS)), []) is None
    ended = spoken.verdict(11.0 + AFTERMATH, view(task_status(SUCCESS)), [])
    assert ended is not None
    assert ended.outcome == "completed"


def test_time_runs_out_and_services_die() -> None:
    late = judge().verdict(100.0, view(task_status()), [])
    assert late is not None
    assert late.outcome == "timed out"
    short = judge(seconds=5.0)
    assert short.verdict(30.0, view(task_status(), heard=False), []) is None
    assert short.verdict(31.0, view(task_status()), []) is None
    ended = short.verdict(36.0, view(task_status()), [])
    assert ended is not None
    assert ended.outcome == "timed out"
    dead = [Exit("wbc", -9, expected=False, restarted=False, tail=())]
    ended = judge().verdict(5.0, view(task_status()), dead)
    assert ended is not None
    assert ended.outcome == "service died"


def test_a_task_is_done_by_the_synthetic_operator_unless_a_script_is_named() -> None:
    task = SystemOptions(task="door/unlock", seed=7)
    assert isinstance(_operator_and_judge(DemoOptions(task, script="gaits"))[1], ScriptJudge)
    assert isinstance(_operator_and_judge(DemoOptions())[1], ScriptJudge)
    operator, its_judge = _operator_and_judge(DemoOptions(task))
    assert isinstance(its_judge, TaskJudge)
    assert operator.args == ("synthetic", "--task", "door/unlock", "--seed", "7", "--stay")
