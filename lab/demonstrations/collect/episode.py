"""Makes one episode: runs the trial, then renders its pictures if it is to be kept."""

from dataclasses import dataclass
from functools import lru_cache
from time import perf_counter

from common.episodes.columns import CAMERAS
from common.episodes.episode_file import PERIOD_NS, EpisodeMeta, to_bytes
from common.plant.config import PHYSICS_STEP_NS
from common.schemas import PlantState, SceneState
from lab.demonstrations.collect.config import EpisodeConfig, PictureConfig, collecting_code
from lab.demonstrations.collect.recorder import EpisodeRecorder
from lab.errors import StoppedError
from lab.trials.spec import TrialResult
from lab.trials.stack import TaskStack
from lab.trials.workers import Stop, stop_request
from services.sim.rendering.cameras import CameraConfig, StereoRenderer, encode
from services.sim.tasks import find_task


@dataclass(frozen=True)
class EpisodeResult:
    """An episode, ready to be kept.

    Attributes:
        meta: its metadata.
        content: content of its file; None: it is not to be kept.
        simulated: robot time that was run [s].
        wall: wall-clock time that this took [s].
        rendering: part of that time that the pictures took [s].
    """

    meta: EpisodeMeta
    content: bytes | None
    simulated: float
    wall: float
    rendering: float = 0.0


def make_episode(config: EpisodeConfig, seed: int, stop: Stop | None = None) -> EpisodeResult:
    """Run the trial with ``seed`` and return its episode.

    A trial whose simulation fails is an episode with the verdict ``error``, never kept.

    Args:
        config: settings of the episode.
        seed: seed of the trial.
        stop: requests that the episode is given up; None: the request to this process.

    Raises:
        StoppedError: the episode was given up.
        RenderingUnavailableError: there is no off-screen OpenGL.
    """
    began = perf_counter()
    stop = stop or stop_request()
    stack = TaskStack(config.trial(seed))
    recorder = EpisodeRecorder(stack)
    result = stack.run_or_error(stop)
    meta = _meta(config, recorder, result)
    content, rendering = None, 0.0
    if meta.success or (config.keep_failures and meta.verdict != "error"):
        before = perf_counter()
        pictures = {}
        if config.pictures is not None:
            pictures = render(config.task, config.pictures, recorder.scenes, stop)
        rendering = perf_counter() - before
        content = to_bytes(meta, recorder.rows, pictures, recorder.names)
    return EpisodeResult(meta, content, result.simulated, perf_counter() - began, rendering)


def _meta(config: EpisodeConfig, recorder: EpisodeRecorder, result: TrialResult) -> EpisodeMeta:
    code, size = collecting_code(config.operator), config.pictures
    step = config.physics_steps * PHYSICS_STEP_NS
    return EpisodeMeta(
        operator=config.operator.kind,
        task=config.task,
        goal=find_task(config.task).goal,
        seed=result.seed,
        verdict=result.verdict,
        reason=result.reason,
        completion_time=result.time,
        verdict_frame=recorder.verdict_frame,
        frames=len(recorder.rows),
        # The steps of robot time need not fit into the period of the frames.
        frame_tolerance=step * 1e-9 if PERIOD_NS % step else 0.0,
        picture_size=None if size is None else (size.width, size.height),
        stages=result.stages,
        gave_up=result.gave_up,
        origin=config.origin(),
        versions=code.versions,
        source=code.source,
        machine=code.machine,
    )


@lru_cache(maxsize=2)
def _renderer(config: CameraConfig) -> StereoRenderer:
    return StereoRenderer(config)


def render(
    task: str, pictures: PictureConfig, scenes: list[tuple[PlantState, SceneState]], stop: Stop
) -> dict[str, list[bytes]]:
    """Return JPEG files by camera, one for each of ``scenes``.

    Raises:
        StoppedError: ``stop`` was set meanwhile.
    """
    renderer = _renderer(pictures.camera(find_task(task).scene))
    files: dict[str, list[bytes]] = {camera: [] for camera in CAMERAS}
    for state, objects in scenes:
        if stop.is_set():
            raise StoppedError("the episode was given up")
        for camera, image in zip(CAMERAS, renderer.render(state, CAMERAS, objects), strict=True):
            files[camera].append(encode(image, "jpeg", pictures.quality))
    return files
