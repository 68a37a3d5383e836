"""Runs a trial and draws its contact sheet, to look at what the operator does."""

from functools import partial
from pathlib import Path
from typing import Any

import cv2

from common.schemas import Message
from common.topics import CAMERA_LEFT, PLANT_TRUTH, TASK_SCENE, TASK_STATUS, TELEOP_STATUS, Topic
from lab.errors import LabError
from lab.review.frames import Image, write_picture
from lab.review.task_contact_sheet import TILE, task_contact_sheet, task_title
from lab.review.timeline import Timeline, read_timeline
from lab.trials.links import links_text
from lab.trials.spec import TrialResult, TrialSpec
from lab.trials.stack import TaskStack
from services.sim.rendering.cameras import CameraConfig, StereoRenderer
from services.sim.scenes import find_scene

LARGEST = 150_000
"""A JPEG file has at most this size [bytes]."""
_TOPICS: tuple[Topic[Any], ...] = (
    PLANT_TRUTH,
    TASK_SCENE,
    TASK_STATUS,
    TELEOP_STATUS,
    CAMERA_LEFT,
)


def record_trial(spec: TrialSpec) -> tuple[TrialResult, Timeline]:
    """Run a trial; returns its result and what its pictures are drawn from."""
    stack = TaskStack(spec)
    messages: list[tuple[Topic[Any], Message]] = []

    def keep(topic: Topic[Any], message: Message) -> None:
        messages.append((topic, message))

    for topic in _TOPICS:
        stack.runner.on_message(topic, partial(keep, topic))
    return stack.run(), read_timeline(messages)


def write_sheet(
    result: TrialResult, timeline: Timeline, path: Path, view: int | None = None
) -> None:
    """Write the key moments of a trial as one picture.

    Args:
        result: result of the trial.
        timeline: timeline of the trial.
        path: the picture; a JPEG file is kept below :data:`LARGEST`.
        view: number of the scene's camera; None: the one that shows the task best.

    Raises:
        RenderingUnavailableError: there is no off-screen OpenGL.
        LabError: the file cannot be written.
    """
    assert timeline.task is not None
    links = "" if not result.links else f", link {links_text(result.links)}"
    title = f"{task_title(timeline, timeline.task)}, in simulated time{links}"
    if result.verdict != "success":
        title += f": {result.reason}"
    camera = None if view is None else find_scene(timeline.scene).views[view]
    renderer = StereoRenderer(CameraConfig(scene=timeline.scene, width=TILE[0], height=TILE[1]))

    def left_camera(index: int) -> Image:
        objects = next(timeline.scene_states_at([index]))
        return renderer.render(timeline.truth[index], ["left"], objects)[0]

    try:
        sheet = task_contact_sheet(timeline, title, left_camera, lambda _done, _total: None, camera)
    finally:
        renderer.close()
    check_picture_path(path)
    write_picture(path, sheet, largest_jpeg=LARGEST)


def check_picture_path(path: Path) -> None:
    """Make the folder of a picture, and refuse a name that is not that of a picture.

    Raises:
        LabError: there cannot be a picture.
    """
    if not cv2.haveImageWriter(str(path)):
        raise LabError(f"cannot write {path}: expected a name like sheet.jpg")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LabError(f"cannot make the directory {path.parent}: {error.strerror}") from error
