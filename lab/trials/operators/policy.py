"""Builds the policy of a trial, with the cameras that it sees by."""

import hashlib
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from common.schemas import PlantState, SceneState
from common.tables import validated
from lab.errors import LabError
from lab.trials.operators.kinds import OperatorServices
from lab.trials.operators.specs import PolicySpec, StillPictures
from lab.trials.spec import TrialSpec
from services.policy.checkpoint.manifest import Description, describe
from services.policy.processor.processor import Decision
from services.policy.service import PolicyOperator, local_engine
from services.policy.serving.config import PolicyConfig
from services.policy.serving.engine import Answer, Engine, Request
from services.sim.rendering.cameras import (
    CameraConfig,
    CameraService,
    PictureSource,
    StereoRenderer,
    encode,
)
from services.sim.tasks import find_task

CAMERAS = ("left", "right")


class MeanEngine:
    """Answers every request with the mean action of the policy's data set, and asks for no gait.

    It is the best constant answer: what a policy without any input could do.
    """

    refused, problem, waiting = 0, "", False

    def __init__(self, description: Description) -> None:
        interface = description.manifest.interface
        gait = np.zeros(interface.gaits, dtype=np.float32)
        gait[0] = 1.0
        steps = interface.hands[0]
        self._decision = Decision(
            np.zeros(interface.hands, np.float32), np.zeros((steps, 2), np.float32), gait
        )
        self._answers: list[Answer] = []

    def ask(self, request: Request) -> None:
        """Answer at once."""
        self._answers = [Answer(request.step, self._decision, request.memory)]

    def work(self) -> None:
        """Nothing is left to be done."""

    def answers(self) -> list[Answer]:
        """Return the answer to the last request, once."""
        given, self._answers = self._answers, []
        return given

    def close(self) -> None:
        """Nothing is held."""


class _Rendered:
    """Pictures of a renderer that outlives the trial: to open one takes as long as a trial."""

    def __init__(self, config: CameraConfig) -> None:
        self._renderer = _renderer(config)
        self._renderer.reset()
        self.scene = self._renderer.scene

    def files(
        self, state: PlantState, cameras: Sequence[str], objects: SceneState | None = None
    ) -> list[bytes]:
        """Return an encoded picture per camera."""
        return self._renderer.files(state, cameras, objects)

    def close(self) -> None:
        """Keep the renderer for the next trial."""


@lru_cache(maxsize=2)
def _renderer(config: CameraConfig) -> StereoRenderer:
    return StereoRenderer(config)


class _Still:
    """The same picture of each camera at every moment."""

    def __init__(self, scene: str, files: dict[str, bytes]) -> None:
        self.scene = scene
        self._files = files

    def files(
        self, state: PlantState, cameras: Sequence[str], objects: SceneState | None = None
    ) -> list[bytes]:
        """Return an encoded picture per camera."""
        del state, objects
        return [self._files[camera] for camera in cameras]

    def close(self) -> None:
        """Nothing is held."""


def build(spec: TrialSpec) -> OperatorServices:
    """Return the policy, and the camera service if it sees.

    Raises:
        CheckpointError: the checkpoint cannot be served.
        LabError: the checkpoint or the pictures are others than the trial's.
        ConfigError: a field of the serving configuration is wrong.
        RenderingUnavailableError: there is no off-screen OpenGL.
    """
    policy = spec.operator
    assert isinstance(policy, PolicySpec)
    folder = Path(policy.checkpoint)
    config = validated(PolicyConfig, {**policy.serving, "checkpoint": folder, "stay": True})
    engine, description = _engine(policy, config)
    operator = PolicyOperator(config, engine, description)
    if not operator.cameras:
        return OperatorServices(operator, (operator,))
    return OperatorServices(operator, (_cameras(spec, policy, description), operator))


def _engine(policy: PolicySpec, config: PolicyConfig) -> tuple[Engine, Description]:
    description = describe(config.checkpoint)
    if description.digest != policy.digest:
        raise LabError(
            f"{config.checkpoint} is another checkpoint than this trial's: expected digest "
            f"{policy.digest[:12]}…, got {description.digest[:12]}…; give the command again with "
            "the one you mean, which has results of its own"
        )
    if policy.constant:
        return MeanEngine(description), description
    return local_engine(config)


def camera_config(scene: str, description: Description) -> CameraConfig:
    """Return the cameras by which a policy sees: of their usual size, as a live robot's.

    Only a policy that learned from smaller pictures sees smaller ones: rendered small, a picture
    is another than scaled down. The policy's own processor scales to the size of its network.
    """
    size = description.manifest.origin.picture_size
    changed: dict[str, Any] = {} if size is None else {"width": size[0], "height": size[1]}
    return CameraConfig(scene=scene, **changed)


def _cameras(spec: TrialSpec, policy: PolicySpec, description: Description) -> CameraService:
    scene = find_task(spec.task).scene
    config = camera_config(scene, description)
    source: PictureSource
    if policy.constant:
        black = np.zeros((config.height, config.width, 3), np.uint8)
        file = encode(black, config.encoding, config.quality)
        source = _Still(scene, dict.fromkeys(CAMERAS, file))
    elif policy.pictures is not None:
        source = _Still(scene, _still_files(policy.pictures, config))
    else:
        source = _Rendered(config)
    return CameraService(config, source)


def _still_files(pictures: StillPictures, config: CameraConfig) -> dict[str, bytes]:
    path = Path(pictures.file)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise LabError(f"cannot read the pictures {path}: {error.strerror}") from error
    if hashlib.sha256(content).hexdigest() != pictures.sha256:
        raise LabError(f"{path} is another file than this trial's; give the command again")
    both = cv2.cvtColor(cv2.imdecode(np.frombuffer(content, np.uint8), 1), cv2.COLOR_BGR2RGB)
    halves = np.split(both, 2, axis=1)
    size = (config.width, config.height)
    return {
        camera: encode(
            np.asarray(cv2.resize(half, size, interpolation=cv2.INTER_AREA), np.uint8),
            config.encoding,
            config.quality,
        )
        for camera, half in zip(CAMERAS, halves, strict=True)
    }
