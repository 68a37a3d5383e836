"""Makes one episode: runs the trial, then renders its pictures if it is to be kept."""

from dataclasses import dataclass
from time import perf_counter

from common.episodes.episode_file import PERIOD_NS, EpisodeMeta, to_bytes
from common.plant.config import PHYSICS_STEP_NS
from lab.demonstrations.collect.config import EpisodeConfig, PictureConfig, collecting_code
from lab.demonstrations.collect.pictures import MomentNotes, PictureInput, render
from lab.demonstrations.collect.recorder import EpisodeRecorder
from lab.trials.spec import TrialResult
from lab.trials.stack import TaskStack
from lab.trials.workers import Stop, stop_request
from services.sim.rendering.cameras import CameraService
from services.sim.tasks import find_task

UNAIDED = "unaided"
"""Verdict on a trial in which a policy was to be helped and succeeded without."""


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
    stack, notes, pictures = _set_up(config, seed)
    recorder = EpisodeRecorder(stack, pictures, operators=2 if config.helped else 1)
    result = stack.run_or_error(stop)
    meta = _meta(config, recorder, result)
    content, rendering = None, 0.0
    if meta.success or (config.keep_failures and meta.verdict not in {"error", UNAIDED}):
        before = perf_counter()
        files = {}
        if config.pictures is not None:
            moments = (notes.moments[stamp] for stamp in recorder.frames.pictures)
            files = render(config.task, config.pictures, moments, stop)
        rendering = perf_counter() - before
        content = to_bytes(meta, recorder.frames.rows, files, recorder.names)
    return EpisodeResult(meta, content, result.simulated, perf_counter() - began, rendering)


def _set_up(config: EpisodeConfig, seed: int) -> tuple[TaskStack, MomentNotes, PictureInput]:
    """Return the trial, notes of what its pictures show, and what takes these pictures in."""
    notes = MomentNotes(find_task(config.task).scene)
    # A policy brings itself, and cameras of its own if it sees.
    pictures = PictureInput("pictures" if config.helped else "policy")
    # Without pictures too: their times stay in the frames, and the frames the same.
    cameras = CameraService((config.pictures or PictureConfig()).camera(notes.scene), notes)
    stack = TaskStack(config.trial(seed), beside=(pictures,), cameras=cameras)
    if stack.cameras is not cameras:
        notes.follow(stack.runner)
    return stack, notes, pictures


def _meta(config: EpisodeConfig, recorder: EpisodeRecorder, result: TrialResult) -> EpisodeMeta:
    code, size, frames = collecting_code(config.operator), config.pictures, recorder.frames
    step, kind = config.physics_steps * PHYSICS_STEP_NS, config.operator.kind
    # The steps of robot time need not fit into the period of the frames.
    tolerance = step if PERIOD_NS % step else 0
    unaided = config.helped and result.verdict == "success" and frames.operator == "policy"
    return EpisodeMeta(
        operator=frames.operator if kind == "helped" else kind,
        task=config.task,
        goal=find_task(config.task).goal,
        seed=result.seed,
        verdict=UNAIDED if unaided else result.verdict,
        reason="the policy needed no help" if unaided else result.reason,
        completion_time=result.time,
        verdict_frame=recorder.verdict_frame,
        frames=len(frames),
        frame_tolerance=max(tolerance, frames.worst_ns if config.helped else 0) * 1e-9,
        picture_size=None if size is None else (size.width, size.height),
        stages=result.stages,
        gave_up=result.gave_up,
        origin=config.origin(),
        versions=code.versions,
        source=code.source,
        machine=code.machine,
    )
