"""Contact sheet and video as files, where there is a graphics library."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from common.schemas import Gait
from lab.errors import LabError
from lab.review import tiles
from lab.review.frames import with_caption
from lab.review.pictures import COLUMNS, TILE, VIDEO, write_contact_sheet, write_video
from lab.review.report import draw_pictures
from lab.review.timeline import Timeline, read_timeline
from services.logger.read.reader import LogReader
from services.sim.errors import RenderingUnavailableError
from services.sim.rendering.render import render_states
from tests.lab.review.synthetic import FakeRobot, beginning
from tests.lab.review.test_report import recorded
from tests.lab.review.test_timeline import mark, picture, stand


@pytest.fixture(scope="module")
def timeline() -> Timeline:
    robot = FakeRobot()
    pairs = [*stand(robot, 2), mark(robot, "standing"), picture(robot, 200), *stand(robot, 6)]
    pairs += [(t, m) for t, m in robot.gait(0, Gait.FORWARD, (0, 0, 0), (0.2, 0, 0))]
    made = read_timeline(pairs)
    try:
        next(iter(render_states(made.truth[:1], 64, 48)))
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    return made


def quiet(_done: int, _total: int) -> None:
    """No progress bar."""


def test_the_contact_sheet_has_every_moment_and_the_path(
    timeline: Timeline, tmp_path: Path
) -> None:
    path = tmp_path / "sheet.png"
    write_contact_sheet(path, timeline, quiet)
    sheet = cv2.imread(str(path))
    assert sheet is not None
    # One gait, the robot's left eye and the path.
    assert sheet.shape[0] == TILE[1]
    assert TILE[0] * 3 <= sheet.shape[1] < TILE[0] * COLUMNS
    robot = sheet[:, : TILE[0]]
    assert robot.std() > 20.0
    eye = sheet[40:, TILE[0] + 4 : 2 * TILE[0]]
    assert abs(int(np.median(eye)) - 200) <= 2


def test_the_video_plays_at_the_runs_own_pace(timeline: Timeline, tmp_path: Path) -> None:
    done: list[tuple[int, int]] = []
    short = beginning(timeline, 8, labels=timeline.labels, left_images=timeline.left_images)
    write_video(tmp_path / "v.mp4", short, lambda *counts: done.append(counts))
    assert done[-1] == (8, 8)
    video = cv2.VideoCapture(str(tmp_path / "v.mp4"))
    assert video.get(cv2.CAP_PROP_FPS) == pytest.approx(12.5)
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == 8
    good, frame = video.read()
    assert good
    assert frame.shape == (VIDEO[1], VIDEO[0], 3)


def test_without_graphics_the_run_is_as_good(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unavailable(_states: Iterable[Any], *_: Any, **__: Any) -> Iterator[Any]:
        raise RenderingUnavailableError("no off-screen OpenGL: install libegl1")

    monkeypatch.setattr(tiles, "render_states", unavailable)
    recorded(tmp_path)
    log = tmp_path / "log.mcap"
    reason = draw_pictures(log, read_timeline(LogReader(log).messages()), video=True)
    assert reason == "no pictures: no off-screen OpenGL: install libegl1"


def test_a_log_without_ground_truth_has_no_pictures(tmp_path: Path) -> None:
    with pytest.raises(LabError, match="no ground truth"):
        write_video(tmp_path / "v.mp4", Timeline(), quiet)
    with pytest.raises(LabError, match="no ground truth"):
        write_contact_sheet(tmp_path / "s.png", Timeline(), quiet)


def test_a_caption_fits_and_leaves_the_picture_alone() -> None:
    image = np.full((100, 200, 3), 255, np.uint8)
    labelled = with_caption(
        image, "a very long label that is far wider than the picture it is on " * 2
    )
    assert (labelled[24:] == 255).all()
    assert labelled[:24].min() < 100
    assert (image == 255).all()
