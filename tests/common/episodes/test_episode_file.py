"""An episode's file: arrays, names, pictures; and what a reader is told of a wrong one."""

import errno
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

from common.episodes.columns import BY_PATH, COLUMNS
from common.episodes.episode_file import open_episode, to_bytes
from common.episodes.errors import EpisodeAccessError, EpisodeDamagedError, EpisodeError
from common.robot.frames import BODY_FRAME
from tests.lab.demonstrations.collect.support import meta, rows


def jpeg(value: int, width: int = 32, height: int = 16) -> bytes:
    _, file = cv2.imencode(".jpg", np.full((height, width, 3), value, dtype=np.uint8))
    return file.tobytes()


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "e.h5"
    given = rows(frames=4, seed=7)
    eyes = {"left": [jpeg(v) for v in (0, 80, 160, 240)], "right": [jpeg(9)] * 4}
    path.write_bytes(to_bytes(meta(7), given, eyes))
    with open_episode(path) as episode:
        assert episode.meta == meta(7)
        for column in COLUMNS:
            expected = np.array(given.rows[column.path], dtype=column.dtype)
            np.testing.assert_array_equal(episode.array(column.path), expected)
        part = episode.array("action/hands", slice(1, 3))
        np.testing.assert_array_equal(part, episode.array("action/hands")[1:3])
        assert episode.jpeg("left", 2) == eyes["left"][2]
        assert episode.picture("left", 3).shape == (16, 32, 3)
        assert abs(int(episode.picture("left", 1).mean()) - 80) < 3
        with pytest.raises(EpisodeError, match="frame 4"):
            episode.jpeg("left", 4)
        with pytest.raises(EpisodeError, match="unknown array"):
            episode.array("action/feet")


def test_a_file_from_before_a_column_was_added_is_read(tmp_path: Path) -> None:
    path = tmp_path / "e.h5"
    path.write_bytes(to_bytes(meta(7), rows(frames=4), {}))
    with open_episode(path) as episode:
        assert episode.holds("observation/hand_error")
    with h5py.File(path, "r+") as file:
        del file["observation/hand_error"]
        del file["action/neck"]
    with open_episode(path) as episode:
        assert not episode.holds("observation/hand_error")
        assert episode.array("observation/hand_error", slice(1, 3)).shape == (2, 4)
        assert np.isnan(episode.array("observation/hand_error")).all()
        with pytest.raises(EpisodeDamagedError):
            episode.array("action/neck")


def test_the_file_explains_itself_to_any_hdf5_reader(tmp_path: Path) -> None:
    path = tmp_path / "e.h5"
    path.write_bytes(to_bytes(meta(0), rows(), {}))
    with h5py.File(path) as file:
        poses = file["observation/poses"]
        assert poses.attrs["frame"] == BODY_FRAME
        assert poses.attrs["unit"].startswith("m")
        assert list(poses.attrs["names"])[14] == "left_hand.x"
        assert '"operator":"synthetic"' in file.attrs["meta"]
        for column in COLUMNS:
            assert file[column.path].attrs["doc"]


def test_the_widths_are_those_of_the_paper() -> None:
    width = {path: len(column.names) for path, column in BY_PATH.items()}
    assert width["observation/poses"] == 28
    assert width["observation/joint_sin_cos"] == 54
    assert width["observation/joint_velocity"] == 27
    assert width["action/hands"] == 14
    assert width["action/grasp"] == 2


def test_other_files_are_refused(tmp_path: Path) -> None:
    text = tmp_path / "a.h5"
    text.write_text("no episode")
    with pytest.raises(EpisodeError, match=r"a\.h5"), open_episode(text):
        pass
    newer = tmp_path / "b.h5"
    newer.write_bytes(to_bytes(meta(0), rows(), {}))
    with h5py.File(newer, "r+") as file:
        file.attrs["schema_version"] = 99
    with pytest.raises(EpisodeError, match="version 99"), open_episode(newer):
        pass


@contextmanager
def held_open(path: Path) -> Iterator[None]:
    """Another program has the file open for writing."""
    code = (
        f"import h5py, sys\nwith h5py.File({str(path)!r}, 'r+'):\n"
        "    print('open', flush=True)\n    sys.stdin.readline()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "open\n"
        yield
        other.communicate("\n")


def test_what_cannot_be_reached_is_not_damaged(tmp_path: Path) -> None:
    path = tmp_path / "e.h5"
    with pytest.raises(EpisodeAccessError, match="gone"), open_episode(path):
        pass
    path.write_bytes(to_bytes(meta(0), rows(), {}))
    busy = pytest.raises(EpisodeAccessError, match="another program")
    with held_open(path), busy, open_episode(path):
        pass
    with open_episode(path) as episode:
        assert episode.meta.frames == 4
    path.write_bytes(path.read_bytes()[:900])
    with pytest.raises(EpisodeDamagedError, match="damaged"), open_episode(path):
        pass


@pytest.mark.parametrize("number", [errno.EACCES, errno.EIO, errno.EMFILE, errno.ENOLCK])
def test_errors_of_the_system_while_reading_are_not_damage(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "e.h5"
    path.write_bytes(to_bytes(meta(0), rows(), {}))

    def failing(*_arguments: object) -> object:
        raise OSError(number, "no")

    with open_episode(path) as episode:
        monkeypatch.setattr(h5py.Dataset, "__getitem__", failing)
        with pytest.raises(EpisodeAccessError, match="now"):
            episode.array("action/neck")


def test_errors_of_the_readers_own_work_stay_what_they_are(tmp_path: Path) -> None:
    path = tmp_path / "e.h5"
    path.write_bytes(to_bytes(meta(0), rows(), {}))
    with pytest.raises(OSError, match="full"), open_episode(path):
        raise OSError(errno.ENOSPC, "disk full")


def test_cameras_axes_and_the_scenes_joints_are_described(tmp_path: Path) -> None:
    path = tmp_path / "e.h5"
    about = meta(0).model_copy(update={"picture_size": (400, 300)})
    names = {"truth/scene_qpos": ("hinge", "lever", "latch")}
    path.write_bytes(to_bytes(about, rows(), {"left": [b""] * 4, "right": [b""] * 4}, names))
    with h5py.File(path) as file:
        left, right = (file[f"images/{side}"].attrs for side in ("left", "right"))
        focal = 150.0 / np.tan(np.radians(60.0))
        expected = [[focal, 0.0, 199.5], [0.0, focal, 149.5], [0.0, 0.0, 1.0]]
        np.testing.assert_allclose(left["camera_matrix"], expected)
        apart = left["position_in_parent"] - right["position_in_parent"]
        np.testing.assert_allclose(apart, [0.0, left["baseline"], 0.0])
        assert left["parent"] == "neck_pitch_link"
        assert list(file["truth/scene_qpos"].attrs["names"]) == ["hinge", "lever", "latch"]
        assert "x forward" in file["action/hands"].attrs["axes"]
        assert "velocit" in file["observation/joint_velocity"].attrs["doc"]
