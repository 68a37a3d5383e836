"""Pictures of a run: recorded states in, frames out."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from common.schemas import PlantState, SceneState
from services.sim.model.pose import show_state
from services.sim.model.world import build_model, find_addresses
from services.sim.rendering.offscreen import Image, Offscreen, fixed_camera
from services.sim.scenes.base import View


@dataclass(frozen=True, slots=True)
class FollowCamera:
    """A third-person camera that walks along with the robot.

    Attributes:
        azimuth: where it looks, counter-clockwise from +x [deg]; 145 sees the robot's front left.
        elevation: of its view [deg]; negative looks down.
        distance: to the robot [m].
        height: of the point it looks at [m].
        ahead: (x, y) in world from the robot to that point [m].
        lag: time constant with which it follows [s]; steps do not shake the picture.
    """

    azimuth: float = 145.0
    elevation: float = -13.0
    distance: float = 2.5
    height: float = 0.64
    ahead: tuple[float, float] = (0.0, 0.0)
    lag: float = 0.6


class _Still:
    """A camera that stays where it is, in the world or on the robot."""

    def __init__(self, camera: Any) -> None:
        self.camera = camera

    def see(self, _state: PlantState) -> None:
        """Nothing follows."""


class _Follower:
    """Moves a free camera after the robot."""

    def __init__(self, settings: FollowCamera) -> None:
        self._settings = settings
        self._ahead = np.array(settings.ahead)
        self._stamp_ns: int | None = None
        self.camera = mujoco.MjvCamera()
        self.camera.azimuth = settings.azimuth
        self.camera.elevation = settings.elevation
        self.camera.distance = settings.distance
        self.camera.lookat[2] = settings.height

    def see(self, state: PlantState) -> None:
        """Follow to ``state``; at the first, and after time went back, jump there."""
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
        states: what to show, in the order of time.
        width: at most 1920 [pixels].
        height: at most 1080 [pixels].
        camera: one that follows or stays, or the name of one of the model's (``"left"``,
            ``"right"``); None: one that follows.
        scene: what stands around the robot.
        objects: where the scene's things are, one for each state; None leaves them in place.
        fast: no shadows, reflections or smooth edges: with software OpenGL a tenth of the time.

    Raises:
        RenderingUnavailableError: there is no off-screen OpenGL.
        SceneError: there is no such scene, or ``objects`` are of another one.
        ValueError: there are not as many ``objects`` as states.
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
        for state, things in pairs:
            mover.see(state)
            show_state(model, data, addresses, state, things)
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
