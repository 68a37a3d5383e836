"""The robot's stereo pair, rendered in a process of its own so that physics never waits.

Run as ``python -m services.sim.rendering.cameras``.
"""

import logging
import os
import sys
from argparse import SUPPRESS, ArgumentParser, Namespace
from collections.abc import Mapping, Sequence
from typing import Any, Literal, Protocol, Self

import cv2
import mujoco
from pydantic import BaseModel, ConfigDict, Field

from common.robot.frames import CAMERAS
from common.runtime.service import Inputs, Output, Service
from common.schemas import CameraFrame, Header, PlantState, SceneState
from common.tables import validated
from common.topics import CAMERA_LEFT, CAMERA_RIGHT, PLANT_TRUTH, TASK_SCENE
from services.sim.model.robot_state import show_state
from services.sim.model.world import FLOOR_GEOM, build_spec, find_addresses
from services.sim.rendering.offscreen import Image, Offscreen, fixed_camera
from services.sim.scenes import SCENES
from services.sim.scenes.parts import KEY_LIGHT
from services.sim.tasks import find_task

_NICENESS = 10
_MESH_CORNERS = 20
"""Largest number of corners of a mesh in the stereo pair; each costs as much as many pixels."""
_LOG = logging.getLogger(__name__)
DESCRIPTION = """Render the plant's ground truth through the robot's stereo pair and publish each
picture that has a subscriber. Needs EGL (libegl1); the plant runs without."""


class CameraConfig(BaseModel):
    """Configuration of the stereo pair."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    scene: str = Field(default="", description="name of the surroundings; empty: the plant's")
    task: str = Field(default="", description="the plant's task; it sets the scene")
    width: int = Field(default=400, ge=16, le=1920, description="[pixels]")
    height: int = Field(default=300, ge=16, le=1080, description="[pixels]")
    rate: int = Field(default=20, ge=1, le=60, description="pictures per second and camera [Hz]")
    encoding: Literal["jpeg", "rgb8"] = Field(default="jpeg", description="of the pictures")
    quality: int = Field(default=90, ge=1, le=100, description="of JPEG")


_FIELDS = frozenset(CameraConfig.model_fields)


class PictureSource(Protocol):
    """Where the camera service has its pictures from.

    Attributes:
        scene: name of the surroundings.
    """

    scene: str

    def files(
        self, state: PlantState, cameras: Sequence[str], objects: SceneState | None = None
    ) -> list[bytes]:
        """Return an encoded picture per camera; see :meth:`StereoRenderer.render`."""
        ...

    def close(self) -> None:
        """Free what it holds."""
        ...


class StereoRenderer:
    """Renders the robot's stereo pair: upright pictures, row 0 on top.

    Attributes:
        scene: name of the surroundings.
    """

    def __init__(self, config: CameraConfig) -> None:
        self._config = config
        self.scene = config.scene or (find_task(config.task).scene if config.task else "flat")
        self._model = _plain_model(self.scene)
        self._data = mujoco.MjData(self._model)
        self._addresses = find_addresses(self._model)
        self._cameras = {side: fixed_camera(self._model, name) for side, name in CAMERAS.items()}
        self._offscreen = Offscreen(self._model, config.width, config.height, plain=True)

    def render(
        self, state: PlantState, cameras: Sequence[str], objects: SceneState | None = None
    ) -> list[Image]:
        """Return (height, width, 3) RGB pictures, one per camera.

        Args:
            state: of the robot.
            cameras: ``left``, ``right``.
            objects: state of the scene; None: the scene stays as it is.

        Raises:
            SceneError: ``objects`` belong to another scene.
        """
        show_state(self._model, self._data, self._addresses, state, objects)
        return [self._offscreen.render(self._data, self._cameras[name]) for name in cameras]

    def reset(self) -> None:
        """Put the scene back to its start, where nothing has been shown yet."""
        mujoco.mj_resetData(self._model, self._data)

    def files(
        self, state: PlantState, cameras: Sequence[str], objects: SceneState | None = None
    ) -> list[bytes]:
        """Return the pictures of :meth:`render`, encoded as configured."""
        encoding, quality = self._config.encoding, self._config.quality
        images = self.render(state, cameras, objects)
        return [encode(image, encoding, quality) for image in images]

    def close(self) -> None:
        """Free the OpenGL context."""
        self._offscreen.close()


def _plain_model(scene: str) -> Any:
    """Return the model of a scene with quality traded for speed."""
    spec = build_spec(scene)
    for mesh in spec.meshes:
        mesh.maxhullvert = _MESH_CORNERS
    model = spec.compile()
    model.vis.quality.offsamples = 0
    model.vis.map.zfar = 50.0
    floor = model.geom(FLOOR_GEOM)
    floor.size[:] = 60.0, 60.0, 20.0
    # Lighting is computed at the corners of the floor's coarse tiles, too coarse for a spot light.
    model.light(KEY_LIGHT).type = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    return model


def encode(image: Image, encoding: str, quality: int) -> bytes:
    """Return an RGB image (height, width, 3) as a JPEG file or as row-major bytes."""
    if encoding == "rgb8":
        return image.tobytes()
    _, file = cv2.imencode(
        ".jpg", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, quality]
    )
    return file.tobytes()


class CameraService(Service):
    """Publishes the pictures that have a subscriber, from the latest ground truth."""

    name = "cameras"
    reads = (PLANT_TRUTH, TASK_SCENE)
    writes = (CAMERA_LEFT, CAMERA_RIGHT)
    # Software rendering of both cameras takes up to 0.15 s, more on a busy machine.
    heartbeat_timeout_s = 0.5

    def __init__(
        self,
        config: CameraConfig | None = None,
        source: PictureSource | None = None,
    ) -> None:
        """Open the source of pictures.

        Args:
            config: configuration of the cameras.
            source: where pictures come from; None: they are rendered.

        Raises:
            RenderingUnavailableError: pictures are to be rendered, but there is no OpenGL.
        """
        self._config = config or CameraConfig()
        self.settings = self._config.model_dump(mode="json")
        self.period_ns = 1_000_000_000 // self._config.rate
        self._source = source or StereoRenderer(self._config)
        self._warned = False

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Build the cameras for a replay; pictures are the same only with the same OpenGL."""
        return cls(validated(CameraConfig, settings))

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Render the cameras that have a subscriber, if there is a new state."""
        del now_ns
        state = inputs.latest(PLANT_TRUTH)
        if state is None or not inputs.updated(PLANT_TRUTH):
            return []
        topics = {
            side: topic
            for side, topic in (("left", CAMERA_LEFT), ("right", CAMERA_RIGHT))
            if self.wanted(topic)
        }
        objects = inputs.latest(TASK_SCENE)
        if objects is not None and objects.scene != self._source.scene:
            objects = self._follow(objects)
        files = self._source.files(state, list(topics), objects)
        return [
            Output(topic, self._frame(side, file, state.header.stamp))
            for (side, topic), file in zip(topics.items(), files, strict=True)
        ]

    def _follow(self, objects: SceneState) -> SceneState | None:
        """Switch to the plant's scene unless one is configured; returns the objects to show."""
        if self._config.scene or self._config.task:
            if not self._warned:
                shown = self._source.scene
                _LOG.warning("showing the scene %s, but the plant's is %s", shown, objects.scene)
            self._warned = True
            return None
        config = self._config.model_copy(update={"scene": objects.scene})
        self._source.close()
        self._source = StereoRenderer(config)
        return objects

    def _frame(self, side: str, file: bytes, stamp_ns: int) -> CameraFrame:
        return CameraFrame(
            header=Header(stamp=stamp_ns),
            eye="left" if side == "left" else "right",
            width=self._config.width,
            height=self._config.height,
            encoding=self._config.encoding,
            data=file,
        )

    def close(self) -> None:
        """Free the source of pictures."""
        self._source.close()


def _add_arguments(parser: ArgumentParser) -> None:
    parser.prog = "python -m services.sim.rendering.cameras"
    group = parser.add_argument_group("pictures", argument_default=SUPPRESS)
    group.add_argument("--scene", choices=sorted(SCENES), help="surroundings (the plant's)")
    group.add_argument("--task", metavar="NAME", help="the plant's task; it sets the scene")
    group.add_argument("--width", type=int, help="pixels (400)")
    group.add_argument("--height", type=int, help="pixels (300)")
    group.add_argument("--rate", type=int, help="pictures per second and camera (20)")
    group.add_argument("--encoding", choices=["jpeg", "rgb8"], help="picture encoding (jpeg)")
    group.add_argument("--quality", type=int, help="JPEG quality, 1 to 100 (90)")


def _build(arguments: Namespace) -> CameraService:
    options = {name: value for name, value in vars(arguments).items() if name in _FIELDS}
    config = validated(CameraConfig, arguments.settings, options)
    # Pictures may be late, control may not.
    os.nice(_NICENESS)
    return CameraService(config)


def main() -> int:
    """Run the cameras until a signal."""
    # A trial in simulated time hosts the cameras without the bus, which takes long to import.
    from common.runtime.live.main import run_live

    return run_live(
        _build,
        CameraService.name,
        sys.argv[1:],
        add_arguments=_add_arguments,
        description=DESCRIPTION,
        background=True,
    )


if __name__ == "__main__":
    raise SystemExit(main())
