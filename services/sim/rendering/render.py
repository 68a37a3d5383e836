"""Pictures of a run from recorded states, and the cameras that show the tasks best."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np

from common.schemas import PlantState, SceneState
from services.sim.model.robot_state import show_state
from services.sim.model.world import build_model, find_addresses
from services.sim.rendering.offscreen import Image, Offscreen, fixed_camera
from services.sim.scenes import find_scene
from services.sim.scenes.base import View


@dataclass(frozen=True, slots=True)
class FollowCamera:
    """A third-person camera that follows the robot.

    Attributes:
        azimuth: direction of view, counter-clockwise from +x [deg]; 145 sees the robot's front
            left.
        elevation: of the view [deg]; negative looks down.
        distance: to the robot [m].
        height: of the point it looks at [m].
        ahead: (x, y) in world from the robot to that point [m].
        lag: time constant of following, so that steps do not shake the picture [s].
    """

    azimuth: float = 145.0
    elevation: float = -13.0
    distance: float = 2.5
    height: float = 0.64
    ahead: tuple[float, float] = (0.0, 0.0)
    lag: float = 0.6


TASK_VIEWS: Final[dict[str, View]] = {
    "door/unlock": View((0.52, 0.20, 0.89), -50.0, -17.0, 1.35),
    "door/walk": View((0.15, 0.10, 0.76), -60.0, -18.0, 2.5),
    "door/push": View((0.85, 0.0, 0.74), -8.0, -30.0, 2.7),
    "bench/hammer": View((0.45, -0.30, 0.92), 68.0, -25.0, 1.7),
    "bench/walk": View((0.22, -0.45, 0.50), 35.0, -27.0, 3.8),
    "bench/push": View((0.65, -0.65, 0.62), 35.0, -26.0, 3.0),
    "hardware/tool": View((0.36, -0.08, 0.87), -150.0, -26.0, 1.2),
    "hardware/cap": View((0.35, 0.0, 0.93), -140.0, -20.0, 0.95),
}
"""Cameras that show the tasks best."""


def task_view(task: str, scene: str) -> View | FollowCamera:
    """Return the camera of ``task``; without one, the first of its scene or one that follows.

    Raises:
        SceneError: the scene is unknown.
    """
    views = find_scene(scene).views
    return TASK_VIEWS.get(task) or (views[0] if views else FollowCamera())


class _Still:
    """A camera that is fixed in the world or on the robot."""

    def __init__(self, camera: Any) -> None:
        self.camera = camera

    def follow(self, _state: PlantState) -> None:
        """Do nothing."""


class _Follower:
    """A free camera that follows the robot."""

    def __init__(self, settings: FollowCamera) -> None:
        self._settings = settings
        self._ahead = np.array(settings.ahead)
        self._stamp_ns: int | None = None
        self.camera = mujoco.MjvCamera()
        self.camera.azimuth = settings.azimuth
        self.camera.elevation = settings.elevation
        self.camera.distance = settings.distance
        self.camera.lookat[2] = settings.height

    def follow(self, state: PlantState) -> None:
        """Follow to ``state``; jump at the first one and after time went back."""
        stamp = state.header.stamp
        share = 1.0
        if self._stamp_ns is not None and stamp >= self._stamp_ns:
            share = 1.0 - math.exp(-(stamp - self._stamp_ns) * 1e-9 / self._settings.lag)
        self._stamp_ns = stamp
        wanted = state.base_position[:2] + self._ahead
        self.camera.lookat[:2] += share * (wanted - self.camera.lookat[:2])


def _mover(model: Any, camera: FollowCamera | View | str | None) -> _Still | _Follower:
    if isinstance(camera, str):
        return _Still(fixed_camera(model, camera))
    if not isinstance(camera, View):
        return _Follower(camera or FollowCamera())
    free = mujoco.MjvCamera()
    free.azimuth, free.elevation = camera.azimuth, camera.elevation
    free.distance, free.lookat[:] = camera.distance, camera.target
    return _Still(free)


def render_states(
    states: Iterable[PlantState],
    width: int = 1280,
    height: int = 720,
    camera: FollowCamera | View | str | None = None,
    *,
    scene: str = "flat",
    objects: Iterable[SceneState | None] | None = None,
    fast: bool = False,
) -> Iterator[Image]:
    """Render one (height, width, 3) RGB frame per state, with shadows.

    Args:
        states: of the robot, in the order of time.
        width: [pixels].
        height: [pixels].
        camera: a camera, or the name of one of the model's (``"left"``, ``"right"``); None: the
            default camera that follows.
        scene: name of the surroundings.
        objects: states of the scene, one for each robot state; None: the scene does not move.
        fast: no shadows, reflections, smooth edges or fine shapes: with software OpenGL a tenth
            of the time.

    Raises:
        RenderingUnavailableError: no off-screen OpenGL is available.
        SceneError: the scene is unknown, or ``objects`` belong to another one.
        ValueError: ``objects`` and states differ in number.
    """
    model = build_model(scene)
    data = mujoco.MjData(model)
    addresses = find_addresses(model)
    mover = _mover(model, camera)
    if fast:
        model.vis.quality.offsamples = 0
    offscreen = Offscreen(model, width, height, plain=fast)
    try:
        pairs = zip(states, objects, strict=True) if objects else ((s, None) for s in states)
        for state, scene_state in pairs:
            mover.follow(state)
            show_state(model, data, addresses, state, scene_state)
            yield offscreen.render(data, mover.camera)
    finally:
        offscreen.close()


def contact_sheet(frames: Sequence[Image], columns: int, gap: int = 4) -> Image:
    """Lay equally large frames out in rows of ``columns``, ``gap`` white pixels apart.

    Raises:
        ValueError: there are no frames.
    """
    if not frames:
        raise ValueError("expected at least one frame for a contact sheet, got none")
    height, width, _ = frames[0].shape
    rows = math.ceil(len(frames) / columns)
    columns = min(columns, len(frames))
    sheet = np.full(
        (rows * (height + gap) - gap, columns * (width + gap) - gap, 3), 255, dtype=np.uint8
    )
    for i, frame in enumerate(frames):
        top, left = (i // columns) * (height + gap), (i % columns) * (width + gap)
        sheet[top : top + height, left : left + width] = frame
    return sheet
