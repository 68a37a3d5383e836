"""Pictures of a run with a scored task, where there is a graphics library."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from common.schemas import CameraFrame, TaskStatus
from common.topics import CAMERA_LEFT
from lab.review.film import Film, gather
from lab.review.pictures import VIDEO, write_contact_sheet, write_video
from lab.review.task_sheet import (
    COLUMNS,
    TILE,
    headline,
    recorded_eye,
    scene_pictures,
    task_sheet,
)
from services.sim.errors import RenderingUnavailableError
from services.sim.rendering.render import TASK_VIEWS, render_states, task_view
from services.sim.scenes import SCENES
from services.sim.tasks import all_tasks
from tests.lab.review.synthetic import Life
from tests.lab.review.task_life import stand, status, unlocked


def quiet(_done: int, _total: int) -> None:
    """No progress bar."""


@pytest.fixture(scope="module")
def film() -> Film:
    life = Life()
    header = life.header(CAMERA_LEFT, "cameras")
    frame = CameraFrame(
        header=header, eye="left", width=2, height=2, encoding="rgb8", data=bytes([9, 200, 9] * 4)
    )
    start = stand(life, 1)
    made = gather([*start, (CAMERA_LEFT, frame), *unlocked(life)])
    try:
        next(iter(render_states(made.truth[:1], 64, 48)))
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    return made


def test_the_door_is_in_the_picture_and_moves(film: Film) -> None:
    last = len(film.truth) - 1
    closed, ajar = scene_pictures(film, [0, last], 160, 120, fast=True)
    bare = next(iter(render_states(film.truth[:1], 160, 120, task_view("door/unlock", "door"))))
    changed = [float(np.mean(np.abs(closed.astype(int) - other) > 20)) for other in (ajar, bare)]
    assert changed[0] > 0.005
    assert changed[1] > 0.4


def test_the_sheet_of_a_task_has_a_head_its_moments_and_the_eye(film: Film, tmp_path: Path) -> None:
    counts: list[tuple[int, int]] = []
    write_contact_sheet(tmp_path / "s.png", film, {}, lambda *done: counts.append(done))
    assert counts[-1] == (8, 8)
    sheet = cv2.imread(str(tmp_path / "s.png"))
    assert sheet is not None
    assert sheet.shape[1] == COLUMNS * (TILE[0] + 4) - 4
    assert 3 * TILE[1] < sheet.shape[0] < 3 * TILE[1] + 60
    assert float(np.mean(sheet[:24])) > 200.0
    eye = sheet[-TILE[1] + 40 :, 60:340]
    assert np.median(eye.reshape(-1, 3), axis=0).tolist() == [9, 200, 9]


def test_without_cameras_there_is_no_row_of_the_eye(film: Film) -> None:
    blind = Film(truth=film.truth, scenes=film.scenes, news=film.news)
    assert blind.task is not None
    sheet = task_sheet(blind, headline(blind, blind.task), recorded_eye(blind), quiet)
    assert 2 * TILE[1] < sheet.shape[0] < 2 * TILE[1] + 60
    assert headline(blind, blind.task) == "door/unlock  seed 7  SUCCESS after 6.1 s"


def test_a_run_cut_off_at_once_has_a_sheet_too(film: Film) -> None:
    news, left = [(0, film.news[0][1])], [(0, film.left[0][1])]
    short = Film(truth=film.truth[:1], scenes=film.scenes[:1], news=news, left=left)
    sheet = task_sheet(short, "cut off", recorded_eye(short), quiet)
    assert TILE[1] < sheet.shape[0] < 2 * TILE[1] + 60


def test_the_video_shows_the_scene_too(film: Film, tmp_path: Path) -> None:
    short = Film(truth=film.truth[:3], scenes=film.scenes[:3], news=film.news)
    write_video(tmp_path / "v.mp4", short, quiet)
    good, frame = cv2.VideoCapture(str(tmp_path / "v.mp4")).read()
    assert good
    (image,) = scene_pictures(short, [0], *VIDEO, fast=True)
    drawn = np.asarray(cv2.cvtColor(np.asarray(frame, dtype=np.uint8), cv2.COLOR_BGR2RGB))
    away = np.abs(drawn[30:].astype(int) - image[30:])
    assert float(np.mean(away)) < 12.0


def test_every_task_has_a_camera_and_a_new_one_its_scenes_first_view() -> None:
    assert set(TASK_VIEWS) == set(all_tasks())
    assert task_view("door/knock", "door") == SCENES["door"].views[0]
    assert task_view("", "flat") is not None


def test_a_trial_without_a_verdict_has_a_headline_too() -> None:
    message = status(Life(), 1, time=3.0)[1]
    assert isinstance(message, TaskStatus)
    film = Film(script="synthetic door/unlock")
    words = "door/unlock  seed 7  no verdict after 3.0 s   operator: synthetic"
    assert headline(film, message) == words
