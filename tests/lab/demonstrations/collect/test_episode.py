"""One real trial: its frames against the log of the same trial, and the same bytes every time."""

import dataclasses
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from threading import Event
from typing import NoReturn

import numpy as np
import pytest

from common.episodes.episode_file import Episode, open_episode
from common.robot.joints import NUM_JOINTS
from common.robot.kinematics import end_effector_poses
from common.schemas import PlantState, Setpoint
from common.topics import PLANT_STATE, TELEOP_SETPOINT
from common.wire.codec import decode
from lab.demonstrations.collect.check import check
from lab.demonstrations.collect.config import EpisodeConfig, PictureConfig
from lab.demonstrations.collect.episode import EpisodeResult, make_episode
from lab.demonstrations.collect.info import sheet
from lab.demonstrations.collect.store import DatasetStore
from lab.errors import StoppedError
from lab.trials.operators.specs import SyntheticSpec
from lab.trials.stack import TaskStack
from services.sim.errors import RenderingUnavailableError, SimError
from services.sim.tasks import find_task
from services.teleop.synthetic.traits import TRAITS
from tests.lab.demonstrations.collect.support import CODE, CONFIG

BEGUN = CONFIG.model_copy(update={"keep_failures": True})
"""Only the first two seconds: enough for what does not depend on the end."""
LATE = BEGUN.model_copy(update={"links": {"feedback": "250ms"}})


@contextmanager
def short(config: EpisodeConfig) -> Iterator[None]:
    """Trials of settings that keep failures end after two seconds."""
    task = find_task(config.task)
    limit = 2.0 if config.keep_failures else task.limit
    with pytest.MonkeyPatch.context() as patch:
        other = dataclasses.replace(task, limit=limit)
        patch.setattr("services.sim.physics.plant.find_task", lambda _name: other)
        yield


@cache
def made(seed: int, config_json: str, repeat: int = 0) -> EpisodeResult:
    """An episode; ``repeat`` sets repetitions of the same one apart."""
    assert repeat >= 0
    config = EpisodeConfig.model_validate_json(config_json)
    with short(config):
        return make_episode(config, seed)


def of(seed: int, config: EpisodeConfig = CONFIG, repeat: int = 0) -> EpisodeResult:
    return made(seed, config.model_dump_json(), repeat)


@cache
def logged(seed: int) -> tuple[dict[int, PlantState], list[Setpoint]]:
    """Measured states by stamp, and set-points, of the same trial without a recorder."""
    with short(BEGUN):
        stack = TaskStack(BEGUN.trial(seed), record=True)
        stack.run()
    log = stack.runner.log
    states = [decode(s.payload, PlantState) for s in log if s.key.endswith(PLANT_STATE.name)]
    points = [decode(s.payload, Setpoint) for s in log if s.key.endswith(TELEOP_SETPOINT.name)]
    return {state.header.stamp: state for state in states}, points


def written(path: Path, outcome: EpisodeResult) -> Path:
    assert outcome.content is not None, outcome.meta.reason
    path.write_bytes(outcome.content)
    return path


def test_frames_are_those_of_the_trial(tmp_path: Path) -> None:
    states, points = logged(0)
    with open_episode(written(tmp_path / "e.h5", of(0, BEGUN))) as episode:
        assert episode.meta.frames == len(points) > 25
        stamps = episode.array("time/state_ns")
        joints = np.array([states[stamp].joint_position for stamp in stamps.tolist()])
        both = episode.array("observation/joint_sin_cos")
        np.testing.assert_array_equal(both[:, :NUM_JOINTS], np.sin(joints))
        np.testing.assert_array_equal(both[:, NUM_JOINTS:], np.cos(joints))
        poses = [end_effector_poses(q) for q in joints]
        np.testing.assert_array_equal(episode.array("observation/poses"), poses)
        hands = episode.array("action/hands")
        left = np.array([point.left_hand_position_in_body for point in points])
        right = np.array([point.right_hand_position_in_body for point in points])
        np.testing.assert_array_equal(hands[:, :3], left)
        np.testing.assert_array_equal(hands[:, 7:10], right)
        grasp = np.array([point.gripper_closure for point in points])
        np.testing.assert_array_equal(episode.array("action/grasp"), grasp)


def test_frames_in_which_a_hand_is_knocked_off_its_way_are_marked(tmp_path: Path) -> None:
    # Without tremor a hand that does not reach yet moves only when it is knocked.
    traits = TRAITS["steady"].model_copy(update={"slips": 2.0})
    jostled = BEGUN.model_copy(update={"operator": SyntheticSpec(traits=traits)})
    with open_episode(written(tmp_path / "e.h5", of(0, jostled))) as episode:
        slips, hands = episode.array("action/slip"), episode.array("action/hands")
    assert 0.1 < slips.mean() < 0.9
    first = int(np.flatnonzero(slips)[0])
    off = np.linalg.norm(hands[first : first + 7] - hands[first], axis=1)
    assert np.all(slips[first : first + 6] == 1.0)
    assert np.all(np.diff(off) > 0.0)
    assert off[5] > 0.005
    with open_episode(written(tmp_path / "quiet.h5", of(0, BEGUN))) as episode:
        assert not episode.array("action/slip").any()


def test_a_whole_trial_is_a_success_and_passes_every_check(tmp_path: Path) -> None:
    outcome = of(0)
    assert outcome.meta.success
    store = DatasetStore(tmp_path)
    with store.writing(CONFIG, CODE):
        line = store.add(outcome.meta, outcome.content)
    assert check(store) == []
    with open_episode(tmp_path / line.file) as episode:
        assert episode.meta.frames > 80
        assert episode.meta.verdict_frame > 0


def test_time_goes_in_even_steps_and_nothing_is_of_the_future(tmp_path: Path) -> None:
    with open_episode(written(tmp_path / "e.h5", of(0))) as episode:
        time = episode.array("time/robot_ns")
        assert (np.diff(time) == 50_000_000).all()
        for name in ("state", "controller", "truth", "seen"):
            age = episode.array(f"age/{name}")
            assert (age >= 0.0).all()
            assert (age < 0.02).all()
            np.testing.assert_allclose(
                age, (time - episode.array(f"time/{name}_ns")) * 1e-9, atol=1e-12
            )
        verdict = episode.meta.verdict_frame
        assert 0 < verdict < episode.meta.frames
        start = time[verdict] * 1e-9 - episode.meta.completion_time
        # The trial's clock starts with the first command, a moment after robot time 1 s.
        assert 0.9 < start < 1.3


def test_quaternions_do_not_jump(tmp_path: Path) -> None:
    with open_episode(written(tmp_path / "e.h5", of(0))) as episode:
        for path, count in (("observation/poses", 4), ("action/hands", 2)):
            quaternions = episode.array(path).reshape(-1, count, 7)[:, :, 3:]
            assert (np.sum(quaternions[1:] * quaternions[:-1], axis=2) > 0.9).all()


def test_over_a_late_link_the_robot_is_measured_now_and_was_seen_then(tmp_path: Path) -> None:
    late = of(0, LATE)
    assert late.meta.origin["links"] == {"feedback": "250ms"}
    with open_episode(written(tmp_path / "e.h5", late)) as episode:
        assert (episode.array("age/seen") >= 0.25).all()
        assert (episode.array("age/seen") < 0.3).all()
        assert (episode.array("age/state") < 0.02).all()


def test_what_fails_is_counted_and_not_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    task = find_task("door/unlock")
    short = dataclasses.replace(task, limit=0.5)
    monkeypatch.setattr("services.sim.physics.plant.find_task", lambda _name: short)
    outcome = make_episode(CONFIG, 0)
    assert outcome.meta.verdict == "failure"
    assert "not within 0.5 s" in outcome.meta.reason
    assert outcome.content is None
    kept = make_episode(CONFIG.model_copy(update={"keep_failures": True}), 0)
    assert kept.meta.verdict == "failure"
    assert kept.content is not None


def test_a_simulation_that_breaks_off_is_an_error_and_never_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def broken(_stack: TaskStack, _stop: object) -> NoReturn:
        raise SimError("the numbers ran away")

    monkeypatch.setattr(TaskStack, "run", broken)
    outcome = make_episode(CONFIG.model_copy(update={"keep_failures": True}), 0)
    assert outcome.meta.verdict == "error"
    assert "ran away" in outcome.meta.reason
    assert outcome.content is None


def test_it_can_be_stopped() -> None:
    stop = Event()
    stop.set()
    with pytest.raises(StoppedError):
        make_episode(CONFIG, 0, stop)


def _pictured(episode: Episode) -> None:
    first, last = (
        episode.picture("left", 0).astype(int),
        episode.picture("left", episode.meta.frames - 1).astype(int),
    )
    assert first.shape == (48, 64, 3)
    assert first.std() > 10.0
    assert np.abs(first - last).mean() > 3.0
    right = episode.picture("right", 0).astype(int)
    assert np.abs(right - first).mean() > 0.0
    assert sheet(episode, shown=4).shape[1] > 1600


SMALL = BEGUN.model_copy(update={"pictures": PictureConfig(width=64, height=48)})


def test_same_seed_same_bytes_with_pictures_and_another_seed_differs(tmp_path: Path) -> None:
    try:
        outcome = of(0, SMALL)
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    with open_episode(written(tmp_path / "e.h5", outcome)) as episode:
        _pictured(episode)
    # The renderer draws another episode in between.
    assert of(1, SMALL).content != outcome.content
    assert of(0, SMALL, repeat=1).content == outcome.content
