"""An episode's file: arrays, names, pictures; and what a reader is told of a wrong one."""

from pathlib import Path

import cv2
import h5py
import numpy as np
import pytest

from common.episodes.columns import BY_PATH, COLUMNS
from common.episodes.episode_file import open_episode, to_bytes
from common.episodes.errors import EpisodeError
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
