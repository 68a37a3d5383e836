"""Pictures of a run with a scored task, where there is a graphics library."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from common.schemas import CameraFrame, TaskStatus
from common.topics import CAMERA_LEFT
from lab.review.pictures import VIDEO, write_contact_sheet, write_video
from lab.review.task_contact_sheet import (
    COLUMNS,
    TILE,
    recorded_images,
    task_contact_sheet,
    task_title,
)
from lab.review.tiles import render_scene
from lab.review.timeline import Timeline, read_timeline
from services.sim.errors import RenderingUnavailableError
from services.sim.rendering.render import TASK_VIEWS, render_states, task_view
from services.sim.scenes import SCENES
from services.sim.tasks import all_tasks
from tests.lab.review.synthetic import FakeRobot, beginning
from tests.lab.review.synthetic_task import stand, status, unlocked


def quiet(_done: int, _total: int) -> None:
    """No progress bar."""


@pytest.fixture(scope="module")
def timeline() -> Timeline:
    robot = FakeRobot()
    header = robot.header(CAMERA_LEFT, "cameras")
    frame = CameraFrame(
        header=header, eye="left", width=2, height=2, encoding="rgb8", data=bytes([9, 200, 9] * 4)
    )
    start = stand(robot, 1)
    made = read_timeline([*start, (CAMERA_LEFT, frame), *unlocked(robot)])
    try:
        next(iter(render_states(made.truth[:1], 64, 48)))
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    return made


def test_the_door_is_in_the_picture_and_moves(timeline: Timeline) -> None:
    last = len(timeline.truth) - 1
    closed, ajar = render_scene(timeline, [0, last], 160, 120, fast=True)
    bare = next(iter(render_states(timeline.truth[:1], 160, 120, task_view("door/unlock", "door"))))
    changed = [float(np.mean(np.abs(closed.astype(int) - other) > 20)) for other in (ajar, bare)]
    assert changed[0] > 0.005
    assert changed[1] > 0.4


def test_the_sheet_of_a_task_has_a_head_its_moments_and_the_eye(
    timeline: Timeline, tmp_path: Path
) -> None:
    counts: list[tuple[int, int]] = []
    write_contact_sheet(tmp_path / "s.png", timeline, lambda *done: counts.append(done))
    assert counts[-1] == (8, 8)
    sheet = cv2.imread(str(tmp_path / "s.png"))
    assert sheet is not None
    assert sheet.shape[1] == COLUMNS * (TILE[0] + 4) - 4
    assert 3 * TILE[1] < sheet.shape[0] < 3 * TILE[1] + 60
    assert float(np.mean(sheet[:24])) > 200.0
    eye = sheet[-TILE[1] + 40 :, 60:340]
    assert np.median(eye.reshape(-1, 3), axis=0).tolist() == [9, 200, 9]


def test_without_cameras_there_is_no_row_of_the_eye(timeline: Timeline) -> None:
    blind = beginning(timeline, len(timeline.truth), task_changes=timeline.task_changes)
    assert blind.task is not None
    sheet = task_contact_sheet(blind, task_title(blind, blind.task), recorded_images(blind), quiet)
    assert 2 * TILE[1] < sheet.shape[0] < 2 * TILE[1] + 60
    assert task_title(blind, blind.task) == "door/unlock  seed 7  SUCCESS after 6.1 s"


def test_a_run_cut_off_at_once_has_a_sheet_too(timeline: Timeline) -> None:
    news = [(0, timeline.task_changes[0][1])]
    short = beginning(timeline, 1, task_changes=news, left_images=timeline.left_images)
    sheet = task_contact_sheet(short, "cut off", recorded_images(short), quiet)
    assert TILE[1] < sheet.shape[0] < 2 * TILE[1] + 60


def test_the_video_shows_the_scene_too(timeline: Timeline, tmp_path: Path) -> None:
    short = beginning(timeline, 3, task_changes=timeline.task_changes)
    write_video(tmp_path / "v.mp4", short, quiet)
    good, frame = cv2.VideoCapture(str(tmp_path / "v.mp4")).read()
    assert good
    (image,) = render_scene(short, [0], *VIDEO, fast=True)
    drawn = np.asarray(cv2.cvtColor(np.asarray(frame, dtype=np.uint8), cv2.COLOR_BGR2RGB))
    away = np.abs(drawn[30:].astype(int) - image[30:])
    assert float(np.mean(away)) < 12.0


def test_every_task_has_a_camera_and_a_new_one_its_scenes_first_view() -> None:
    assert set(TASK_VIEWS) == set(all_tasks())
    assert task_view("door/knock", "door") == SCENES["door"].views[0]
    assert task_view("", "flat") is not None


def test_a_trial_without_a_verdict_has_a_headline_too() -> None:
    message = status(FakeRobot(), 1, time=3.0)[1]
    assert isinstance(message, TaskStatus)
    timeline = Timeline(operator_script="synthetic door/unlock")
    words = "door/unlock  seed 7  no verdict after 3.0 s   operator: synthetic"
    assert task_title(timeline, message) == words
