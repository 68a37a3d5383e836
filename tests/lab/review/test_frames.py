"""Pictures as arrays and as files."""

from pathlib import Path
from typing import Literal

import cv2
import numpy as np
import pytest

from common.schemas import CameraFrame
from lab.errors import LabError
from lab.review.frames import decode_frame, write_picture
from tests.disk import fill

RED = np.full((40, 60, 3), (250, 10, 20), np.uint8)


def test_a_picture_keeps_its_colours(tmp_path: Path) -> None:
    write_picture(tmp_path / "red.png", RED)
    image = cv2.imread(str(tmp_path / "red.png"))
    assert image is not None
    assert image[0, 0].tolist() == [20, 10, 250]


def test_a_full_disk_is_no_success_and_leaves_the_picture_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "red.png"
    write_picture(path, RED)
    before = path.read_bytes()
    fill(monkeypatch)
    with pytest.raises(LabError, match="No space left"):
        write_picture(path, RED // 2)
    assert path.read_bytes() == before
    assert [each.name for each in tmp_path.iterdir()] == ["red.png"]


@pytest.mark.parametrize("name", ["red.txt", "red", "none/red.png"])
def test_where_no_picture_can_be_is_told(name: str, tmp_path: Path) -> None:
    with pytest.raises(LabError, match="cannot write"):
        write_picture(tmp_path / name, RED)


@pytest.mark.parametrize(
    ("encoding", "data"), [("jpeg", b""), ("jpeg", b"no jpeg"), ("rgb8", b"short")]
)
def test_a_damaged_frame_is_black(encoding: Literal["jpeg", "rgb8"], data: bytes) -> None:
    frame = CameraFrame(eye="left", width=4, height=2, encoding=encoding, data=data)
    assert decode_frame(frame).shape == (2, 4, 3)
    assert not decode_frame(frame).any()
