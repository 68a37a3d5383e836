"""Trials of a scored task in the summary and the report."""

import pytest

from common.schemas import Gait, TaskVerdict
from lab.review.report import report_lines
from lab.review.run_summary import RunSummary
from lab.review.summary import summarise
from lab.review.task_moments import task_moments
from lab.review.timeline import read_timeline
from tests.lab.review.synthetic import FakeRobot
from tests.lab.review.synthetic_task import reset_by, stand, status, unlocked

SUCCESS, PARTIAL, FAILURE = TaskVerdict.SUCCESS, TaskVerdict.PARTIAL, TaskVerdict.FAILURE


def summary(verdict: TaskVerdict) -> RunSummary:
    return summarise(unlocked(FakeRobot(), verdict))


def test_the_summary_has_verdict_stages_and_undesired_contacts() -> None:
    (trial,) = summary(PARTIAL).trials
    assert (trial.task, trial.seed, trial.verdict, trial.time) == ("door/unlock", 7, "partial", 6.0)
    assert {stage.name: stage.at for stage in trial.stages} == pytest.approx(
        {"lever pressed": 3.0, "door ajar": 5.0, "door unlocked": 6.0}
    )
    assert [(touch.name, touch.peak) for touch in trial.undesired] == [("left wrist on jamb", 12.0)]
    assert trial.operator == "synthetic door/unlock"
    report = "\n".join(report_lines(summary(PARTIAL)))
    assert (
        "door/unlock seed 7 by synthetic door/unlock: PARTIAL after 6.0 of 60 s: it was a partial"
    ) in report
    assert "lever pressed 3.0 s, door ajar 5.0 s, door unlocked 6.0 s" in report
    assert "left wrist on jamb at 5.0 s (peak 12 N)" in report
    assert "no contact" in "\n".join(report_lines(summary(SUCCESS)))


def test_every_trial_counts_and_a_run_without_a_task_has_none() -> None:
    robot = FakeRobot()
    pairs = [*unlocked(robot), status(robot, 0, resets=1, time=0.0), status(robot, 0, resets=2)]
    robot.now += 1000
    pairs.append(status(robot, 1, resets=2, time=3.0))
    trials = summarise(pairs).trials
    assert [(t.verdict, t.time) for t in trials] == [("success", 6.0), ("running", 3.0)]
    assert [stage.at for stage in trials[1].stages] == [3.0, None, None]
    report = report_lines(summarise(pairs))
    assert any("no verdict after 3.0 of 60 s" in line for line in report)
    assert any("lever pressed 3.0 s, door ajar -" in line for line in report)
    bare = summarise(robot.gait(0, Gait.FORWARD, (0, 0, 0), (0.2, 0, 0)))
    assert bare.trials == []
    assert not any("stages" in line for line in report_lines(bare))
    old = bare.model_dump(mode="json")
    del old["trials"]
    assert RunSummary.model_validate(old) == bare


def test_a_trial_before_the_first_operator_does_not_count() -> None:
    robot = FakeRobot()
    idle = [*stand(robot, 6), status(robot), *stand(robot, 5), status(robot, 0, FAILURE)]
    after = [status(robot, 0, FAILURE), *stand(robot, 5), status(robot, 0, resets=1, time=0.0)]
    done = status(robot, 3, SUCCESS, resets=1)
    for source, seed, verdicts in (
        ("up", 7, ["success"]),
        # A further operator: the trial before was that of the first.
        ("up", 8, ["failure", "success"]),
        ("keyboard", 7, ["failure", "success"]),
    ):
        pairs = [*idle, reset_by(robot, source, seed), *after, done]
        assert [trial.verdict for trial in summarise(pairs).trials] == verdicts
        labels = " ".join(moment.label for moment in task_moments(read_timeline(pairs), 0))
        assert ("FAILURE" in labels) == ("failure" in verdicts)
        assert "SUCCESS" in labels


def test_a_restarted_plant_begins_a_new_trial() -> None:
    robot = FakeRobot()
    idle = [*stand(robot, 6), status(robot), *stand(robot, 5), status(robot, 1, FAILURE)]
    topic, again = status(robot, 3, SUCCESS)
    header = again.header.model_copy(update={"boot": again.header.boot + 1})
    anew = (topic, again.model_copy(update={"header": header}))
    pairs = [*idle, reset_by(robot, "up", 7), *stand(robot, 5), anew]
    assert [trial.verdict for trial in summarise(pairs).trials] == ["success"]
    labels = [moment.label for moment in task_moments(read_timeline(pairs), 0)]
    assert labels == ["start; lever pressed; door ajar; door unlocked; SUCCESS"]
