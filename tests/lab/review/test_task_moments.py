"""Moments and captions of a scored task."""

import pytest

from common.schemas import TaskVerdict
from common.topics import PLANT_TRUTH
from lab.review.task_moments import task_caption, task_moments, trial_seconds
from lab.review.timeline import read_timeline
from tests.lab.review.synthetic import FakeRobot
from tests.lab.review.synthetic_task import operator, stand, status, unlocked


def test_moments_are_start_stages_and_verdict_and_halve_the_longest_gaps() -> None:
    timeline = read_timeline(unlocked(FakeRobot()))
    found = {m.label: trial_seconds(timeline, m.index) for m in task_moments(timeline, 4)}
    assert found == pytest.approx(
        {"start": 0.1, "lever pressed": 3.0, "door ajar": 5.0, "door unlocked; SUCCESS": 6.0}
    )
    more = task_moments(timeline, 6)
    assert [m.label for m in more] == [
        *("start", "to the lever", "lever pressed", "to the lever", "door ajar"),
        "door unlocked; SUCCESS",
    ]
    assert [trial_seconds(timeline, m.index) for m in more][1] == pytest.approx(1.5, abs=0.1)
    assert len(task_moments(timeline, 1000)) <= len(timeline.truth)
    assert trial_seconds(timeline, 0) == 0.0


def test_undesired_contacts_falls_and_a_trial_without_a_verdict_are_shown() -> None:
    robot = FakeRobot()
    timeline = read_timeline([*unlocked(robot, TaskVerdict.PARTIAL)])
    labels = [m.label for m in task_moments(timeline, 0)]
    assert labels[2] == "door ajar; undesired: left wrist on jamb"
    assert labels[-1] == "door unlocked; PARTIAL"
    timeline.fall = len(timeline.truth) - 1
    assert task_moments(timeline, 0)[-1].label == "FELL"

    robot = FakeRobot()
    open_end = read_timeline(
        [*stand(robot, 6), status(robot), *stand(robot, 10), operator(robot, "pulling")]
    )
    last = task_moments(open_end, 0)[-1]
    assert last.index == len(open_end.truth) - 1
    assert read_timeline([]).task is None
    assert task_moments(read_timeline([])) == []
    assert len(task_moments(read_timeline([*stand(robot, 1), status(robot, time=1.0)]), 8)) == 1


def test_before_the_first_scene_state_the_scene_is_as_in_that_state() -> None:
    robot = FakeRobot()
    timeline = read_timeline(
        [robot.plant(PLANT_TRUTH, 0, 0, 0), *stand(robot, 3, 0.1), *stand(robot, 3, 0.4)]
    )
    hinges = [state.qpos[0] for state in timeline.scene_states_at(range(7)) if state]
    assert hinges == [0.1, 0.1, 0.1, 0.1, 0.4, 0.4, 0.4]
    assert timeline.scene == "door"
    flat = read_timeline([robot.plant(PLANT_TRUTH, 0, 0, 0)])
    assert flat.scene == "flat"
    assert list(flat.scene_states_at([0])) == [None]


def test_each_ground_truth_has_a_caption() -> None:
    timeline = read_timeline(unlocked(FakeRobot()))
    assert task_caption(timeline, 0) == ""
    assert task_caption(timeline, 40) == (
        "door/unlock  running  1/3 stages  lever pressed  (to the lever)"
    )
