"""Makes one episode: runs the trial, then renders it if it is to be kept."""

import threading
from dataclasses import dataclass
from functools import lru_cache
from time import perf_counter
from typing import Protocol

from common.episodes.columns import EYES
from common.episodes.episode_file import EpisodeMeta, to_bytes
from common.errors import TrillError
from common.schemas import PlantState, SceneState
from lab.demonstrations.collect.recipe import EpisodeConfig, Eyes, source, versions
from lab.demonstrations.collect.recorder import EpisodeRecorder
from lab.errors import StoppedError
from lab.trials.stack import TaskStack
from services.sim.rendering.cameras import CameraConfig, StereoRenderer, encode
from services.sim.tasks import find_task


class Stop(Protocol):
    """Tells that an end is wanted; an event of threading or multiprocessing."""

    def is_set(self) -> bool:
        """Whether it is."""
        ...


@dataclass(frozen=True)
class EpisodeResult:
    """An episode, ready to be kept.

    Attributes:
        meta: what is known of it.
        content: its file; None: it is not to be kept.
        simulated: robot time run [s].
        wall: time it took [s].
        rendering: of which for pictures [s].
    """

    meta: EpisodeMeta
    content: bytes | None
    simulated: float
    wall: float
    rendering: float = 0.0


def make_episode(recipe: EpisodeConfig, seed: int, stop: Stop | None = None) -> EpisodeResult:
    """Run the trial with ``seed`` and return it.

    A trial whose simulation fails is an episode with the verdict ``error``, never kept.

    Raises:
        StoppedError: ``stop`` was set meanwhile.
        RenderingUnavailableError: there is no off-screen OpenGL.
    """
    began = perf_counter()
    stopping = stop if stop is not None else threading.Event()
    stack = TaskStack(recipe.trial(seed))
    recorder = EpisodeRecorder(stack, stopping.is_set)
    try:
        meta = _run(stack, recorder, recipe, seed)
    finally:
        stack.runner.close()
    simulated = stack.runner.now_ns * 1e-9
    wanted = meta.success or (recipe.keep_failures and meta.verdict != "error")
    if not wanted:
        return EpisodeResult(meta, None, simulated, perf_counter() - began)
    drawn = perf_counter()
    pictures = render(recipe.task, recipe.eyes, recorder.scenes, stopping) if recipe.eyes else {}
    rendering = perf_counter() - drawn
    content = to_bytes(meta, recorder.rows, pictures)
    return EpisodeResult(meta, content, simulated, perf_counter() - began, rendering)


def _run(
    stack: TaskStack, recorder: EpisodeRecorder, recipe: EpisodeConfig, seed: int
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
    return EpisodeMeta(
        task=recipe.task,
        seed=seed,
        verdict=verdict,
        reason=reason,
        completion_time=time,
        verdict_frame=recorder.verdict_frame,
        frames=len(recorder.rows),
        stages=stages,
        gave_up=gave_up,
        recipe=recipe,
        versions=versions(),
        source=source(),
    )


@lru_cache(maxsize=2)
def _renderer(config: CameraConfig) -> StereoRenderer:
    return StereoRenderer(config)


def render(
    task: str, eyes: Eyes, scenes: list[tuple[PlantState, SceneState]], stop: Stop
) -> dict[str, list[bytes]]:
    """JPEG files by eye, one for each of ``scenes``.

    Raises:
        StoppedError: ``stop`` was set meanwhile.
    """
    renderer = _renderer(eyes.camera(find_task(task).scene))
    files: dict[str, list[bytes]] = {eye: [] for eye in EYES}
    for state, objects in scenes:
        if stop.is_set():
            raise StoppedError("the episode was given up")
        for eye, image in zip(EYES, renderer.render(state, EYES, objects), strict=True):
            files[eye].append(encode(image, "jpeg", eyes.quality))
    return files
