"""What a run with a scored task shows and says."""

import io
from typing import Any

import pytest
from rich.console import Console

from common.schemas import PlantStatus, TaskStatus, TaskVerdict
from deploy.process import Exit
from deploy.system import SystemOptions, synthetic_operator
from lab.live.demo import DemoOptions, ScriptJudge, _judge
from lab.live.new_trials import OperatorArrivals
from lab.live.task_judge import AFTERMATH, VERDICT_TIMEOUT, TaskJudge
from lab.monitor.bus_stats import BusStats, ServiceRow, Snapshot
from lab.monitor.status_text import format_line
from lab.monitor.table import render_table
from lab.review.report import report_lines
from lab.review.run_summary import RunSummary
from lab.review.summary import summarise
from lab.review.task_moments import task_caption, task_moments, trial_seconds
from lab.review.timeline import read_timeline
from tests.lab.monitor.test_bus_stats import sample
from tests.lab.review.synthetic import Life, Pair
from tests.lab.review.task_life import health, operator, reset_by, stand, status, unlocked

SUCCESS, PARTIAL, FAILURE = TaskVerdict.SUCCESS, TaskVerdict.PARTIAL, TaskVerdict.FAILURE


def test_the_moments_are_start_stages_verdict_and_what_is_longest_between() -> None:
    timeline = read_timeline(unlocked(Life()))
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
    life = Life()
    timeline = read_timeline([*unlocked(life, PARTIAL)])
    labels = [m.label for m in task_moments(timeline, 0)]
    assert labels[2] == "door ajar; undesired: left wrist on jamb"
    assert labels[-1] == "door unlocked; PARTIAL"
    timeline.fall = len(timeline.truth) - 1
    assert task_moments(timeline, 0)[-1].label == "FELL"

    life = Life()
    open_end = read_timeline(
        [*stand(life, 6), status(life), *stand(life, 10), operator(life, "pulling")]
    )
    last = task_moments(open_end, 0)[-1]
    assert last.index == len(open_end.truth) - 1
    assert read_timeline([]).task is None
    assert task_moments(read_timeline([])) == []
    assert len(task_moments(read_timeline([*stand(life, 1), status(life, time=1.0)]), 8)) == 1


def test_the_scene_is_as_it_was_and_before_it_was_heard_as_it_was_first() -> None:
    life = Life()
    timeline = read_timeline([life.plant(*_truth()), *stand(life, 3, 0.1), *stand(life, 3, 0.4)])
    hinges = [state.qpos[0] for state in timeline.scene_states_at(range(7)) if state]
    assert hinges == [0.1, 0.1, 0.1, 0.1, 0.4, 0.4, 0.4]
    assert timeline.scene == "door"
    flat = read_timeline([life.plant(*_truth())])
    assert flat.scene == "flat"
    assert flat.scene_states_at([0]) == [None]


def _truth() -> tuple[Any, float, float, float]:
    from common.topics import PLANT_TRUTH

    return PLANT_TRUTH, 0.0, 0.0, 0.0


def test_each_ground_truth_has_its_words() -> None:
    timeline = read_timeline(unlocked(Life()))
    assert task_caption(timeline, 0) == ""
    assert task_caption(timeline, 40) == (
        "door/unlock  running  1/3 stages  lever pressed  (to the lever)"
    )


def summary(verdict: TaskVerdict) -> RunSummary:
    return summarise(unlocked(Life(), verdict))


def test_the_summary_has_verdict_stages_and_undesired_contacts() -> None:
    (trial,) = summary(PARTIAL).trials
    assert (trial.task, trial.seed, trial.verdict, trial.time) == ("door/unlock", 7, "partial", 6.0)
    assert {stage.name: stage.at for stage in trial.stages} == pytest.approx(
        {"lever pressed": 3.0, "door ajar": 5.0, "door unlocked": 6.0}
    )
    assert [(touch.name, touch.peak) for touch in trial.undesired] == [("left wrist on jamb", 12.0)]
    assert trial.operator == "synthetic door/unlock"
    said = "\n".join(report_lines(summary(PARTIAL)))
    assert (
        "door/unlock seed 7 by synthetic door/unlock: PARTIAL after 6.0 of 60 s: it was a partial"
    ) in said
    assert "lever pressed 3.0 s, door ajar 5.0 s, door unlocked 6.0 s" in said
    assert "left wrist on jamb at 5.0 s (peak 12 N)" in said
    assert "no contact" in "\n".join(report_lines(summary(SUCCESS)))


def test_every_trial_of_a_run_counts_and_a_run_without_a_task_says_nothing_of_one() -> None:
    life = Life()
    pairs = [*unlocked(life), status(life, 0, resets=1, time=0.0), status(life, 0, resets=2)]
    life.now += 1000
    pairs.append(status(life, 1, resets=2, time=3.0))
    trials = summarise(pairs).trials
    assert [(t.verdict, t.time) for t in trials] == [("success", 6.0), ("running", 3.0)]
    assert [stage.at for stage in trials[1].stages] == [3.0, None, None]
    said = report_lines(summarise(pairs))
    assert any("no verdict after 3.0 of 60 s" in line for line in said)
    assert any("lever pressed 3.0 s, door ajar -" in line for line in said)
    bare = summarise(life.gait(0, *_forward()))
    assert bare.trials == []
    assert not any("stages" in line for line in report_lines(bare))
    old = bare.model_dump(mode="json")
    del old["trials"]
    assert RunSummary.model_validate(old) == bare


def _forward() -> tuple[Any, tuple[float, float, float], tuple[float, float, float]]:
    from common.schemas import Gait

    return Gait.FORWARD, (0.0, 0.0, 0.0), (0.2, 0.0, 0.0)


def view(
    task: TaskStatus | None, *, failed: str = "", fallen: bool = False, heard: bool = True
) -> Snapshot:
    life = Life()
    plant, doing = life.status(fallen=fallen)[1], operator(life, failed=failed)[1]
    control = life.wbc()[1]
    assert isinstance(plant, PlantStatus)
    values: dict[str, Any] = {"control": control if heard else None, "operator": doing}
    return Snapshot((), (), plant=plant, task=task, **values)


def said(verdict: TaskVerdict = TaskVerdict.RUNNING, done: int = 1, **changes: Any) -> TaskStatus:
    message = status(Life(), done, verdict, time=12.3, **changes)[1]
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
    one, seen = judge(), view(said(verdict), fallen=fallen)
    assert one.verdict(5.0, view(said()), []) is None
    assert one.verdict(10.0, seen, []) is None
    ended = one.verdict(10.0 + AFTERMATH, seen, [])
    assert ended is not None
    assert ended.outcome == outcome
    assert ended.reason == f"door/unlock seed 7: it was a {verdict.name.lower()}"


def test_an_operator_that_gives_up_or_ends_leaves_the_judge_some_seconds() -> None:
    one, seen = judge(), view(said(), failed="the lever slipped")
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
    dead = [(Exit("teleop", 2, expected=False, restarted=False, tail=("what?",)), True)]
    assert two.verdict(3.0, view(None), dead) is None
    ended = two.verdict(3.0 + VERDICT_TIMEOUT, view(None), [])
    assert ended is not None
    assert "what?" in ended.reason
    assert "no task status" in ended.reason
    spoken = judge()
    assert spoken.verdict(10.0, seen, []) is None
    assert spoken.verdict(11.0, view(said(SUCCESS)), []) is None
    ended = spoken.verdict(11.0 + AFTERMATH, view(said(SUCCESS)), [])
    assert ended is not None
    assert ended.outcome == "completed"


def test_time_runs_out_and_services_die() -> None:
    late = judge().verdict(100.0, view(said()), [])
    assert late is not None
    assert late.outcome == "timed out"
    short = judge(seconds=5.0)
    assert short.verdict(30.0, view(said(), heard=False), []) is None
    assert short.verdict(31.0, view(said()), []) is None
    ended = short.verdict(36.0, view(said()), [])
    assert ended is not None
    assert ended.outcome == "timed out"
    dead = [(Exit("wbc", -9, expected=False, restarted=False, tail=()), True)]
    ended = judge().verdict(5.0, view(said()), dead)
    assert ended is not None
    assert ended.outcome == "service died"


def test_a_task_is_done_by_the_synthetic_operator_unless_a_script_is_named() -> None:
    task = SystemOptions(task="door/unlock", seed=7)
    assert isinstance(_judge(DemoOptions(task)), TaskJudge)
    assert isinstance(_judge(DemoOptions(task, script="gaits")), ScriptJudge)
    assert isinstance(_judge(DemoOptions()), ScriptJudge)
    args = synthetic_operator("door/unlock", 7).args
    assert args == ("synthetic", "--task", "door/unlock", "--seed", "7", "--stay")


def shown(*pairs: Pair) -> tuple[str, str]:
    """Table and line of what was heard."""
    stats = BusStats("draco3")
    stats.add(sample(pair, at=float(i)) for i, pair in enumerate(pairs))
    seen = stats.snapshot(now_ns=len(pairs) * 1_000_000_000)
    console = Console(width=150, file=io.StringIO(), record=True)
    console.print(render_table(seen, "title"))
    return console.export_text(), format_line(seen)


def test_the_table_and_the_line_show_how_the_task_stands() -> None:
    life = Life()
    touched = status(life, 1, time=12.3, touched=("left wrist on jamb",))
    table, words = shown(life.status(), touched)
    assert "task        door/unlock seed 7  12.3/60 s  RUNNING  stage 1/3: lever pressed" in table
    assert "undesired: left wrist on jamb" in table
    assert (
        "door/unlock seed 7  12.3/60 s RUNNING, stage 1/3: lever pressed, next: door ajar, "
        "undesired: left wrist on jamb"
    ) in words
    table, words = shown(status(life, 3, PARTIAL))
    assert "PARTIAL: it was a partial, stage 3/3: door unlocked, no undesired contact" in words
    table, words = shown(life.status())
    assert "task" not in table
    assert "seed" not in words


def with_operators(task: TaskStatus | None, *operators: tuple[str, int]) -> Snapshot:
    """Who is there: services with the number of their life."""
    rows = tuple(ServiceRow(health(Life(), *who), health_age=0.1) for who in operators)
    return Snapshot((), rows, task=task)


def test_who_comes_late_gets_a_new_trial_and_nobody_else_does() -> None:
    running, over = said(), said(SUCCESS)
    new = OperatorArrivals()
    assert new.new_seed(with_operators(running, ("wbc", 1), ("sim", 1))) is None
    assert new.new_seed(with_operators(running, ("wbc", 1), ("teleop", 1))) == 7
    assert new.new_seed(with_operators(over, ("wbc", 1), ("teleop", 1))) is None
    assert new.new_seed(with_operators(over, ("wbc", 2))) is None
    assert new.new_seed(with_operators(over, ("teleop", 2))) == 8
    assert new.new_seed(with_operators(over, ("teleop", 2), ("keyboard", 1))) is None
    assert new.new_seed(with_operators(over, ("keyboard", 1))) is None

    early = OperatorArrivals()
    assert early.new_seed(with_operators(None, ("teleop", 1))) is None
    start = status(Life(), time=0.0)[1]
    assert isinstance(start, TaskStatus)
    assert early.new_seed(with_operators(start, ("teleop", 1))) is None
    assert early.new_seed(with_operators(running, ("teleop", 1))) is None
    assert early.new_seed(with_operators(running, ("teleop", 2))) == 8


def test_what_passed_before_the_operator_came_is_nobodys_trial() -> None:
    life = Life()
    idle = [*stand(life, 6), status(life), *stand(life, 5), status(life, 0, FAILURE)]
    after = [status(life, 0, FAILURE), *stand(life, 5), status(life, 0, resets=1, time=0.0)]
    done = status(life, 3, SUCCESS, resets=1)
    for source, seed, verdicts in (
        ("up", 7, ["success"]),
        # A further operator's: the trial before was that of another.
        ("up", 8, ["failure", "success"]),
        ("keyboard", 7, ["failure", "success"]),
    ):
        pairs = [*idle, reset_by(life, source, seed), *after, done]
        assert [trial.verdict for trial in summarise(pairs).trials] == verdicts
        labels = " ".join(moment.label for moment in task_moments(read_timeline(pairs), 0))
        assert ("FAILURE" in labels) == ("failure" in verdicts)
        assert "SUCCESS" in labels


def test_a_plant_started_anew_has_trials_of_its_own() -> None:
    life = Life()
    idle = [*stand(life, 6), status(life), *stand(life, 5), status(life, 1, FAILURE)]
    topic, again = status(life, 3, SUCCESS)
    header = again.header.model_copy(update={"boot": again.header.boot + 1})
    anew = (topic, again.model_copy(update={"header": header}))
    pairs = [*idle, reset_by(life, "up", 7), *stand(life, 5), anew]
    assert [trial.verdict for trial in summarise(pairs).trials] == ["success"]
    labels = [moment.label for moment in task_moments(read_timeline(pairs), 0)]
    assert labels == ["start; lever pressed; door ajar; door unlocked; SUCCESS"]
