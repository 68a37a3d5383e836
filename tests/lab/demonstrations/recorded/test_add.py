"""A trial's log becomes the episode that its recorder made, and one that can be learned from."""

import shutil
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import pytest

from common.errors import ConfigError
from common.schemas import EpisodeAction
from common.topics import TELEOP_SETPOINT
from common.transport.tap import RawSample
from common.wire.header import wire_header
from lab.cli.main import main
from lab.demonstrations.collect.check import check
from lab.demonstrations.collect.config import EpisodeConfig
from lab.demonstrations.collect.pictures import MomentNotes, PictureInput
from lab.demonstrations.collect.recorder import EpisodeRecorder
from lab.demonstrations.collect.store import DatasetStore
from lab.demonstrations.frames import EpisodeFrames
from lab.demonstrations.recorded.add import AddOptions, _span, add_run, recording_code
from lab.demonstrations.recorded.config import RecordedConfig
from lab.demonstrations.recorded.takes import Take
from lab.trials.stack import TaskStack
from services.logger.record.config import LoggerConfig
from services.logger.record.sink import McapSink
from services.sim.rendering.cameras import CameraConfig, CameraService, encode
from tests.lab.demonstrations.collect.support import CODE, CONFIG
from tests.lab.demonstrations.collect.test_helped import helped
from tests.lab.demonstrations.test_frames import header, moment
from tests.services.logger.support import mark
from tests.services.policy.served import BLIND, saved
from tests.services.teleop.support import at_left

pytest.importorskip("torch")


class Grey(MomentNotes):
    """Notes what the cameras see, and shows grey pictures."""

    _file = encode(np.full((300, 400, 3), 128, np.uint8), "jpeg", 90)

    def files(self, *shown: Any) -> list[bytes]:
        return [self._file] * len(super().files(*shown))


class Trial(NamedTuple):
    """A trial in which an operator took over from a policy: its log, and its recorder."""

    log: list[RawSample]
    recorder: EpisodeRecorder


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Trial:
    policy = saved(tmp_path_factory.mktemp("policy") / "checkpoint", BLIND)
    config: EpisodeConfig = helped(policy, latest=0.2)
    pictures, notes = PictureInput("pictures"), Grey("door")
    stack = TaskStack(
        config.trial(0),
        beside=(pictures,),
        cameras=CameraService(CameraConfig(scene="door"), notes),
        record=True,
    )
    recorder = EpisodeRecorder(stack, pictures, operators=2)
    assert stack.run().verdict == "success"
    return Trial(stack.runner.log, recorder)


def written(path: Path, log: list[RawSample]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    sink = McapSink(path, "draco3", LoggerConfig(), {"recording": str(path)})
    for sample in log:
        sink.write(sample, wire_header(sample.payload))
    sink.close()
    return path


@pytest.fixture
def log(trial: Trial, tmp_path: Path) -> Path:
    return written(tmp_path / "run" / "log.mcap", trial.log)


def test_the_log_gives_the_frames_that_were_recorded_in_the_trial(
    trial: Trial, log: Path, tmp_path: Path
) -> None:
    store = DatasetStore(tmp_path / "set")
    (meta,) = add_run(log, store, AddOptions()).metas
    assert (meta.verdict, meta.operator, meta.task) == ("success", "mixed", "door/unlock")
    assert meta.recording["run"] == "run"
    assert meta.recording["checkpoints"] == ["ab" * 32] or str(meta.recording["checkpoints"])
    frames = trial.recorder.frames
    with h5py.File(store.root / "episodes" / "000000.h5") as file:
        count = len(file["time/robot_ns"])
        assert 0 <= len(frames) - count <= 2
        for path in (
            *("observation/poses", "observation/control_state", "observation/hand_error"),
            *("action/hands", "action/grasp", "action/locomotion", "intervention"),
            *("time/state_ns", "time/controller_ns", "time/seen_ns", "time/picture_ns"),
        ):
            np.testing.assert_array_equal(
                file[path][:], np.array(frames.rows.rows[path][:count]), path
            )
        assert np.abs(np.diff(file["time/robot_ns"][:]) - 50_000_000).max() <= 10_000_000
        assert file["age/truth"][:].max() <= 0.03
        assert meta.verdict_frame == trial.recorder.verdict_frame


def without(log: list[RawSample], *names: str) -> list[RawSample]:
    return [sample for sample in log if not sample.key.endswith(names)]


def marked(log: list[RawSample], action: EpisodeAction) -> list[RawSample]:
    """The log with a mark before everything, and this one 5 s after the first set-point."""
    begin = next(s.arrival_ns for s in log if s.key.endswith(TELEOP_SETPOINT.name))
    marks = [
        mark(0, 7, EpisodeAction.START, 1, "door"),
        mark(1, 7, action, begin + 5 * 10**9, "hand slipped"),
    ]
    return sorted([*log, *marks], key=lambda sample: sample.arrival_ns)


def test_a_discarded_take_is_listed_and_not_kept(trial: Trial, tmp_path: Path) -> None:
    log = written(tmp_path / "run" / "log.mcap", marked(trial.log, EpisodeAction.DISCARD))
    store = DatasetStore(tmp_path / "set")
    (meta,) = add_run(log, store, AddOptions(keep_failures=True)).metas
    assert (meta.verdict, meta.reason) == ("discarded", "discarded: hand slipped")
    assert [line.file for line in store.index()] == ["rejected/000000.json"]
    assert check(store) == []


def test_without_a_judge_truth_and_cameras_the_marks_decide(trial: Trial, tmp_path: Path) -> None:
    bare = without(trial.log, "task/status", "task/scene", "plant/truth", "left", "right")
    log = written(tmp_path / "run" / "log.mcap", marked(bare, EpisodeAction.END))
    store = DatasetStore(tmp_path / "set")
    with pytest.raises(ConfigError, match="give --task"):
        add_run(log, store, AddOptions())
    (meta,) = add_run(log, store, AddOptions(task="door/unlock")).metas
    assert (meta.verdict, meta.reason) == ("success", "marked as done: hand slipped")
    assert (meta.frames, meta.picture_size) == (101, None)
    assert check(store) == []
    with h5py.File(store.root / "episodes" / "000000.h5") as file:
        assert "truth" not in file
        assert "time/picture_ns" not in file
    copy = shutil.copytree(store.root, tmp_path / "copy")
    words = ["train", "door/unlock", "--data", str(copy), "--data", str(store.root)]
    assert main([*words, "--inputs", "scene", "--out", str(tmp_path / "told")]) == 1
    words += ["--inputs", "blind", "--steps", "2", "--out", str(tmp_path / "blind")]
    assert main(words) == 0


def test_messages_that_the_log_lacks_make_no_episode(trial: Trial, tmp_path: Path) -> None:
    begin = trial.log[-1].arrival_ns // 2
    torn = [s for s in trial.log if not begin < s.arrival_ns < begin + 10**9]
    log = written(tmp_path / "run" / "log.mcap", torn)
    (meta,) = add_run(log, DatasetStore(tmp_path / "set"), AddOptions()).metas
    assert (meta.verdict, meta.reason) == ("error", "frames are missing: the log lacks messages")


def test_rest_is_trimmed_but_for_half_a_second() -> None:
    frames: EpisodeFrames[Any] = EpisodeFrames()
    for number in range(90):
        x = 0.3 + 0.01 * min(max(number - 30, 0), 20)
        message = at_left(x, 0.2, 0.0).model_copy(update={"header": header(100 + 50 * number, 0)})
        frames.setpoint(message, moment(100 + 50 * number))
        frames.rows.rows["observation/control_state"][-1] = 1
    take = Take((1, 0), frames, 0)
    assert _span(take, trim=False) == slice(0, 90)
    # Frames 31 to 50 move, which is judged by the six frames before each.
    assert _span(take, trim=True) == slice(21, 66)
    take.verdict_frame = 70
    assert _span(take, trim=True) == slice(21, 81)


def test_operators_and_simulated_trials_are_not_mixed_silently(log: Path, tmp_path: Path) -> None:
    by_hand = RecordedConfig(task="door/unlock", operators=("person",), picture_size=(400, 300))
    store, code = DatasetStore(tmp_path / "set"), recording_code()
    with store.locked():
        store.adding(by_hand, code, mix=False)
    with pytest.raises(ConfigError, match="by person, these are by mixed"):
        add_run(log, store, AddOptions())
    assert len(add_run(log, store, AddOptions(mix=True)).metas) == 1
    simulated = DatasetStore(tmp_path / "simulated")
    with simulated.writing(CONFIG, CODE):
        pass
    with pytest.raises(ConfigError, match="has simulated trials"):
        add_run(log, simulated, AddOptions(mix=True))


def test_the_set_is_checked_added_to_once_and_shown(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "set"
    command = ["dataset", "add", str(log.parent), "--out", str(out)]
    assert main(command) == 0
    assert "episode 0: door/unlock by mixed" in capsys.readouterr().out
    assert main(command) == 0
    assert "0 takes; 1 were there already" in capsys.readouterr().out
    assert check(DatasetStore(out)) == []
    assert main(["collect", "--info", str(out)]) == 0
    assert "operator: mixed, recorded; links: none" in capsys.readouterr().out
