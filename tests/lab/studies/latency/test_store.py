from pathlib import Path

import pytest

from common.errors import ConfigError
from lab.errors import LabError, LatencyStudyError
from lab.studies.latency.conditions import standard
from lab.studies.latency.plan import TrialKey
from lab.studies.latency.run import StudyProgress, run_study
from lab.studies.latency.store import TRIALS, StudyStore
from tests.lab.studies.latency.support import (
    CODE,
    CONDITIONS,
    HAMMER,
    PLAN,
    UNLOCK,
    fake_executor,
    plan_of,
    trial,
)
from tests.lab.trials.fake_executor import FakeExecutor

OTHER_CODE = CODE.model_copy(update={"versions": {"mujoco": "4"}})


def study(store: StudyStore, episodes: int, executor: FakeExecutor) -> int:
    """Run it; how many trials were there before."""
    return run_study(PLAN, store, lambda: executor, episodes=episodes, jobs=2).resumed


def keys(store: StudyStore) -> list[tuple[str, str, str, int]]:
    return sorted(trial.key for trial in store.trials())


def test_each_trial_is_run_once_whatever_comes_between(tmp_path: Path) -> None:
    whole, cut = StudyStore(tmp_path / "whole"), StudyStore(tmp_path / "cut")
    executor = fake_executor()
    study(whole, 2, executor)
    assert len(executor.given) == 2 * 2 * 4
    assert executor.given == list(PLAN.keys(2))
    assert executor.ended

    dies = fake_executor(fails_at=range(6, 100))
    with pytest.raises(LabError, match="fewer --jobs"):
        study(cut, 2, dies)
    assert dies.ended
    there = keys(cut)
    assert 4 <= len(there) < 16
    goes_on = fake_executor()
    assert study(cut, 2, goes_on) == len(there)
    assert len(goes_on.given) == 16 - len(there)
    assert keys(cut) == keys(whole)

    more = fake_executor()
    assert study(cut, 3, more) == 16
    assert {key.seed for key in more.given} == {2}
    assert study(cut, 2, nobody := fake_executor()) == 16
    assert nobody.given == []


def test_a_lost_worker_costs_only_time(tmp_path: Path) -> None:
    said: list[str] = []
    executor = fake_executor(fails_at={3, 7})
    run_study(
        PLAN, StudyStore(tmp_path), lambda: executor, episodes=1, jobs=2, on_message=said.append
    )
    assert len(executor.given) == 8 + 2
    assert len(set(keys(StudyStore(tmp_path)))) == len(keys(StudyStore(tmp_path))) == 8
    assert len(said) == 2


def test_a_torn_last_line_is_run_anew(tmp_path: Path) -> None:
    store = StudyStore(tmp_path)
    study(store, 1, fake_executor())
    path = tmp_path / TRIALS
    content = path.read_bytes()
    path.write_bytes(content[:-30])
    assert len(store.trials()) == 7
    executor = fake_executor()
    assert study(store, 1, executor) == 7
    assert len(executor.given) == 1
    assert path.read_bytes() == content


def test_a_line_that_lacks_only_its_end_is_torn_too(tmp_path: Path) -> None:
    store = StudyStore(tmp_path)
    study(store, 1, fake_executor())
    path = tmp_path / TRIALS
    path.write_bytes(path.read_bytes()[:-1])
    assert study(store, 1, fake_executor()) == 7
    assert len(keys(store)) == len(set(keys(store))) == 8


def test_damage_within_is_no_torn_line(tmp_path: Path) -> None:
    store = StudyStore(tmp_path)
    study(store, 1, fake_executor())
    path = tmp_path / TRIALS
    path.write_bytes(path.read_bytes().replace(b'"seed":0', b'"seed":"', 1))
    with pytest.raises(LabError, match="line 1"):
        store.trials()


@pytest.mark.parametrize(
    ("other", "says"),
    [
        (plan_of(*CONDITIONS[:3]), "conditions.latency-500: command=500ms | absent"),
        (plan_of(*standard("both")), "latency-250: command=250ms | both=250ms"),
        (plan_of(*CONDITIONS, tasks=(UNLOCK,)), f"tasks: {UNLOCK}, {HAMMER} | {UNLOCK}"),
        (plan_of(*CONDITIONS, physics_steps=5), "physics_steps: 1 | 5"),
        (plan_of(*CONDITIONS, code=OTHER_CODE), "mujoco: 3 | 4"),
    ],
)
def test_other_settings_are_refused(tmp_path: Path, other: object, says: str) -> None:
    store = StudyStore(tmp_path)
    study(store, 1, fake_executor())
    before = (tmp_path / TRIALS).read_bytes()
    executor = fake_executor()
    with pytest.raises(ConfigError, match="begun with other settings") as refused:
        run_study(other, store, lambda: executor, episodes=2, jobs=1)  # type: ignore[arg-type]
    assert says in str(refused.value)
    assert executor.given == []
    assert (tmp_path / TRIALS).read_bytes() == before


def test_a_label_is_no_other_setting(tmp_path: Path) -> None:
    store = StudyStore(tmp_path)
    study(store, 1, fake_executor())
    plain = plan_of(*(c.model_copy(update={"label": ""}) for c in CONDITIONS))
    assert run_study(plain, store, fake_executor, episodes=1, jobs=2).resumed == 8


def test_where_no_study_can_be_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    store = StudyStore(tmp_path / "file")
    with pytest.raises(LatencyStudyError, match="choose another --out"):
        study(store, 1, fake_executor())
    with pytest.raises(LatencyStudyError, match="cannot read"):
        store.plan()
    (tmp_path / "study" / TRIALS).mkdir(parents=True)
    with pytest.raises(LabError, match="give the same command again"):
        StudyStore(tmp_path / "study").add(trial())


def test_only_one_writes(tmp_path: Path) -> None:
    store = StudyStore(tmp_path)
    with store.writing(PLAN), pytest.raises(LatencyStudyError, match="another process"):
        study(StudyStore(tmp_path), 1, fake_executor())


def test_persons_have_a_file_of_their_own(tmp_path: Path) -> None:
    store = StudyStore(tmp_path)
    with store.adding() as add:
        add(trial(operator="human", participant="P01"))
    assert store.trials() == []
    assert [t.participant for t in store.human_trials()] == ["P01"]


def test_time_left_is_that_of_the_trials_missing(tmp_path: Path) -> None:
    left: list[float | None] = []
    run_study(
        PLAN,
        StudyStore(tmp_path),
        fake_executor,
        episodes=1,
        jobs=2,
        on_progress=lambda progress, _row: left.append(progress.left),
    )
    # Eight trials of 4 s, two at a time.
    assert left[0] is None
    assert left[1] == pytest.approx(14.0)
    assert left[-1] == 0.0


def test_the_time_left_is_that_of_trials_like_those_missing() -> None:
    todo = [
        TrialKey(1, UNLOCK, "raw"),
        TrialKey(1, UNLOCK, "interpolation"),
        TrialKey(1, HAMMER, "raw"),
    ]
    assert StudyProgress(2, todo, ()).left is None
    there = [
        trial("raw", wall=4.0),
        trial("raw", seed=2, wall=6.0),
        trial("interpolation", wall=11.0),
    ]
    progress = StudyProgress(2, todo, there)
    assert (progress.resumed, progress.done, progress.wanted) == (3, 3, 6)
    # Of hammer there is none yet: the mean of all.
    assert progress.left == pytest.approx((5.0 + 11.0 + 7.0) / 2)
    progress.add(trial("raw", seed=1, task=HAMMER, wall=19.0))
    assert progress.left == pytest.approx((5.0 + 11.0) / 2)
    progress.add(trial("raw", seed=1, wall=8.0))
    # One trial keeps one worker busy only.
    assert progress.left == pytest.approx(11.0)
    progress.add(trial("interpolation", seed=1))
    assert (progress.left, progress.done, progress.resumed) == (0.0, 6, 3)
