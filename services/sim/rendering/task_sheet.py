"""Contact sheets of the scenes: pictures from outside and through the stereo pair."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import mujoco
import numpy as np

from common.robot.frames import CAMERAS
from common.schemas import PlantState, SceneState
from services.sim.config import SimConfig
from services.sim.model.robot_state import show_state
from services.sim.model.world import build_model, find_addresses
from services.sim.physics.plant import Plant
from services.sim.rendering.cameras import CameraConfig, StereoRenderer
from services.sim.rendering.offscreen import Image, Offscreen
from services.sim.rendering.render import contact_sheet
from services.sim.scenes import find_scene
from services.sim.scenes.base import View
from services.sim.tasks.registry import all_tasks

PICTURE = (480, 360)
"""Width and height of one picture of a sheet [pixels]."""
QUALITY = 82
"""Quality of the JPEG files."""
NECK = 0.45
"""Pitch of the head, which looks down at the hands [rad]."""


def outside_pictures(
    scene: str, views: tuple[View, ...], state: PlantState, objects: SceneState
) -> list[Image]:
    """Return pictures of a state from cameras outside, with shadows.

    Raises:
        RenderingUnavailableError: no off-screen OpenGL is available.
    """
    model = build_model(scene)
    data = mujoco.MjData(model)
    show_state(model, data, find_addresses(model), state, objects)
    offscreen = Offscreen(model, *PICTURE)
    camera, pictures = mujoco.MjvCamera(), []
    try:
        for view in views:
            camera.lookat[:] = view.target
            camera.azimuth, camera.elevation = view.azimuth, view.elevation
            camera.distance = view.distance
            pictures.append(offscreen.render(data, camera))
    finally:
        offscreen.close()
    return pictures


def stereo_pictures(scene: str, state: PlantState, objects: SceneState) -> list[Image]:
    """Return the pictures of the left and the right camera as they are published.

    Raises:
        RenderingUnavailableError: no off-screen OpenGL is available.
    """
    renderer = StereoRenderer(CameraConfig(scene=scene))
    try:
        frames = renderer.render(state, list(CAMERAS), objects)
    finally:
        renderer.close()
    # Enlarged without smoothing, so that the sheet shows the pixels there are.
    return [
        np.asarray(cv2.resize(frame, PICTURE, interpolation=cv2.INTER_NEAREST), dtype=np.uint8)
        for frame in frames
    ]


def start_of(task: str, seed: int = 0) -> tuple[PlantState, SceneState]:
    """Return robot and scene at the start of a trial, with the head looking down."""
    plant = Plant(SimConfig(task=task, seed=seed))
    plant.data.joint("neck_pitch").qpos[:] = NECK
    return plant.truth(), plant.view.state(plant.now_ns, plant.reset_count)


def scene_sheet(scene: str, task: str) -> Image:
    """Return a scene's sheet: three views of the start of ``task``, both cameras, another task."""
    state, objects = start_of(task)
    pictures = outside_pictures(scene, find_scene(scene).views, state, objects)
    pictures += stereo_pictures(scene, state, objects)
    others = [t.name for t in all_tasks().values() if t.scene == scene and t.name != task]
    last = others[0] if others else task
    state, objects = start_of(last, seed=1)
    pictures += outside_pictures(scene, find_scene(scene).views[:1], state, objects)
    return contact_sheet(pictures, columns=3)


SHOWN = {
    "door": "door/unlock",
    "bench": "bench/hammer",
    "tool": "hardware/tool",
    "cap": "hardware/cap",
}
"""Task whose start shows a scene."""


def picture_name(scene: str) -> str:
    """Return the file name of a scene's sheet."""
    return f"{scene}.jpg"


def write_sheets(directory: Path) -> Iterator[Path]:
    """Write ``<scene>.jpg`` for each scene that has a task, and yield each path.

    Raises:
        RenderingUnavailableError: no off-screen OpenGL is available.
        OSError: the directory cannot be written.
    """
    directory.mkdir(parents=True, exist_ok=True)
    for scene in dict.fromkeys(task.scene for task in all_tasks().values()):
        first = next(task.name for task in all_tasks().values() if task.scene == scene)
        sheet = scene_sheet(scene, SHOWN.get(scene, first))
        _, file = cv2.imencode(
            ".jpg", cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, QUALITY]
        )
        path = directory / picture_name(scene)
        path.write_bytes(file.tobytes())
        yield path
