"""A trial as a sheet of pictures, to look at what the operator does."""

from pathlib import Path
from typing import Any

import cv2

from common.errors import TrillError
from common.files import write_whole
from common.schemas import Message
from common.topics import PLANT_TRUTH, TASK_SCENE, TASK_STATUS, TELEOP_STATUS, Topic
from lab.review.frames import Image
from lab.review.task_contact_sheet import TILE, task_contact_sheet, task_title
from lab.review.timeline import Timeline, read_timeline
from lab.trials.links import links_text
from lab.trials.spec import TrialResult, TrialSpec
from lab.trials.stack import TaskStack
from services.sim.rendering.cameras import CameraConfig, StereoRenderer
from services.sim.scenes import find_scene

LARGEST = 150_000
"""Of a JPEG file [bytes]."""
_QUALITIES = (88, 82, 76, 70, 62, 54, 46)
_SHOWN = (PLANT_TRUTH, TASK_SCENE, TASK_STATUS, TELEOP_STATUS)


class FilmError(TrillError):
    """A sheet cannot be written."""


def record(spec: TrialSpec) -> tuple[TrialResult, Timeline]:
    """Run a trial and keep what its pictures are made from."""
    stack = TaskStack(spec)
    heard: list[tuple[Topic[Any], Message]] = []

    def keep(topic: Topic[Any]) -> None:
        stack.runner.on_message(topic, lambda message: heard.append((topic, message)))

    for topic in _SHOWN:
        keep(topic)
    try:
        return stack.run(), read_timeline(heard)
    finally:
        stack.runner.close()


def write_sheet(
    result: TrialResult, timeline: Timeline, path: Path, view: int | None = None
) -> None:
    """Write the key moments of a trial as one picture.

    Args:
        result: of the trial.
        timeline: of the trial.
        path: of the picture; a JPEG is kept below :data:`LARGEST`.
        view: number of the scene's camera; None: the one that shows the task best.

    Raises:
        RenderingUnavailableError: there is no off-screen OpenGL.
        FilmError: the file cannot be written.
    """
    assert timeline.task is not None
    links = "" if not result.links else f", link {links_text(result.links)}"
    title = f"{task_title(timeline, timeline.task)}, in simulated time{links}"
    if result.verdict != "success":
        title += f": {result.reason}"
    camera = None if view is None else find_scene(timeline.scene).views[view]
    renderer = StereoRenderer(CameraConfig(scene=timeline.scene, width=TILE[0], height=TILE[1]))

    def eye(index: int) -> Image:
        (things,) = timeline.scene_states_at([index])
        return renderer.render(timeline.truth[index], ["left"], things)[0]

    try:
        sheet = task_contact_sheet(timeline, title, eye, lambda _done, _total: None, camera)
    finally:
        renderer.close()
    check_place(path)
    try:
        write_whole(path, _encoded(sheet, path.suffix))
    except OSError as error:
        raise FilmError(f"cannot write {path}: {error.strerror}") from error


def check_place(path: Path) -> None:
    """Make the directory of a picture, and refuse a name that is none, before anything is run.

    Raises:
        FilmError: there cannot be a picture.
    """
    if not cv2.haveImageWriter(str(path)):
        raise FilmError(f"cannot write {path}: expected a name like sheet.jpg")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FilmError(f"cannot make the directory {path.parent}: {error.strerror}") from error


def _encoded(sheet: Image, suffix: str) -> bytes:
    """A file's content; of a JPEG the best quality that is small enough."""
    picture, file = cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR), b""
    if suffix.lower() not in {".jpg", ".jpeg"}:
        return cv2.imencode(suffix, picture)[1].tobytes()
    for quality in _QUALITIES:
        _, encoded = cv2.imencode(suffix, picture, [cv2.IMWRITE_JPEG_QUALITY, quality])
        file = encoded.tobytes()
        if len(file) <= LARGEST:
            break
    return file
