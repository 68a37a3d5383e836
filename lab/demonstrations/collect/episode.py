"""Makes one episode: runs the trial, then renders its pictures if it is to be kept."""

import threading
from dataclasses import dataclass
from functools import lru_cache
from time import perf_counter

from common.episodes.columns import CAMERAS
from common.episodes.episode_file import PERIOD_NS, EpisodeMeta, to_bytes
from common.errors import TrillError
from common.plant.config import PHYSICS_STEP_NS
from common.schemas import PlantState, SceneState
from lab.demonstrations.collect.config import EpisodeConfig, PictureConfig, collecting_code
from lab.demonstrations.collect.recorder import EpisodeRecorder
from lab.errors import StoppedError
from lab.trials.stack import TaskStack
from lab.trials.workers import Stop
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

    Raises:
        StoppedError: ``stop`` was set meanwhile.
        RenderingUnavailableError: there is no off-screen OpenGL.
    """
    began = perf_counter()
    stopping = stop if stop is not None else threading.Event()
    stack = TaskStack(config.trial(seed))
    recorder = EpisodeRecorder(stack, stopping.is_set)
    try:
        meta = _run(stack, recorder, config, seed)
    finally:
        stack.runner.close()
    simulated = stack.runner.now_ns * 1e-9
    wanted = meta.success or (config.keep_failures and meta.verdict != "error")
    if not wanted:
        return EpisodeResult(meta, None, simulated, perf_counter() - began)
    drawn = perf_counter()
    pictures = (
        render(config.task, config.pictures, recorder.scenes, stopping) if config.pictures else {}
    )
    rendering = perf_counter() - drawn
    content = to_bytes(meta, recorder.rows, pictures)
    return EpisodeResult(meta, content, simulated, perf_counter() - began, rendering)


def _run(
    stack: TaskStack, recorder: EpisodeRecorder, config: EpisodeConfig, seed: int
) -> EpisodeMeta:
    try:
        result = stack.run()
        verdict, reason, time = result.verdict, result.reason, result.time
        stages, gave_up = result.stages, result.gave_up
        if stack.plant.plant.reset_count:
            verdict, reason = "error", "the physics diverged and the plant was reset"
    except StoppedError:
        raise
    except TrillError as error:
        verdict, reason, time = "error", f"{type(error).__name__}: {error}"[:400], 0.0
        stages, gave_up = (), ""
    code, size = collecting_code(), config.pictures
    step = config.physics_steps * PHYSICS_STEP_NS
    return EpisodeMeta(
        operator="synthetic",
        task=config.task,
        goal=find_task(config.task).goal,
        seed=seed,
        verdict=verdict,
        reason=reason,
        completion_time=time,
        verdict_frame=recorder.verdict_frame,
        frames=len(recorder.rows),
        # Robot time goes in steps that need not fit into the frames' period.
        frame_tolerance=step * 1e-9 if PERIOD_NS % step else 0.0,
        picture_size=None if size is None else (size.width, size.height),
        stages=stages,
        gave_up=gave_up,
        origin=config.origin(),
        versions=code.versions,
        source=code.source,
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
