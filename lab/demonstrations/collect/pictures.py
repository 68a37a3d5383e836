"""The pictures of an episode: chosen while the trial runs, rendered afterwards if it is kept.

The trial hosts the camera service itself, whose ticks decide which moment a picture shows and when
it is published. Only its source of pictures is another: it notes what it would draw.
"""

from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache

from common.episodes.columns import CAMERAS, RATE
from common.runtime.service import Inputs, Output, Service
from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import CameraFrame, PlantState, SceneState
from common.topics import CAMERA_LEFT, CAMERA_RIGHT, PLANT_TRUTH, TASK_SCENE
from lab.demonstrations.collect.config import PictureConfig
from lab.errors import StoppedError
from lab.trials.workers import Stop
from services.sim.rendering.cameras import CameraConfig, StereoRenderer
from services.sim.tasks import find_task

Moment = tuple[PlantState, SceneState | None]
"""States of robot and scene that a stereo pair shows; None: the scene is as at its start."""


class MomentNotes:
    """Stands in for the renderer: notes the moments of pictures, and draws nothing.

    Attributes:
        scene: name of the surroundings.
        moments: what each stereo pair shows, by when it was taken [ns].
    """

    def __init__(self, scene: str) -> None:
        self.scene = scene
        self.moments: dict[int, Moment] = {}
        self._scene: SceneState | None = None

    def files(
        self, state: PlantState, cameras: Sequence[str], objects: SceneState | None = None
    ) -> list[bytes]:
        """Note a moment and return an empty file for each camera."""
        self.moments[state.header.stamp] = (state, objects)
        return [b""] * len(cameras)

    def follow(self, runner: SimTimeRunner) -> None:
        """Note all that cameras other than these could see in a trial that has not begun."""
        runner.on_message(PLANT_TRUTH, self._on_truth)
        runner.on_message(TASK_SCENE, self._on_scene)

    def _on_scene(self, scene: SceneState) -> None:
        self._scene = scene

    def _on_truth(self, state: PlantState) -> None:
        # The scene, if it moves, was published just before.
        self.moments[state.header.stamp] = (state, self._scene)

    def close(self) -> None:
        """Keep the notes."""
        return


class PictureInput(Service):
    """Takes in the stereo pairs as a policy in the operator's place would: over a policy's links.

    It is stepped with the operator and before it.

    Attributes:
        newest: the newest left picture whose right one has arrived too; None: none has.
        on_step: called in each step, after it has taken in what had arrived.
    """

    period_ns = 1_000_000_000 // RATE
    reads = (CAMERA_LEFT, CAMERA_RIGHT)

    def __init__(self, name: str = "policy") -> None:
        self.name = name
        self.newest: CameraFrame | None = None
        self.on_step: Callable[[], None] = lambda: None

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Take in what has arrived."""
        del now_ns
        if inputs.updated(CAMERA_LEFT) or inputs.updated(CAMERA_RIGHT):
            pair = inputs.latest_pair(CAMERA_LEFT, CAMERA_RIGHT)
            self.newest = None if pair is None else pair[0]
        self.on_step()
        return ()


@lru_cache(maxsize=2)
def _renderer(config: CameraConfig) -> StereoRenderer:
    return StereoRenderer(config)


def render(
    task: str, pictures: PictureConfig, moments: Iterable[Moment], stop: Stop
) -> dict[str, list[bytes]]:
    """Return JPEG files by camera, one for each of ``moments``.

    A moment that comes again at once is rendered once.

    Raises:
        StoppedError: ``stop`` was set meanwhile.
    """
    renderer = _renderer(pictures.camera(find_task(task).scene))
    renderer.reset()
    files: dict[str, list[bytes]] = {camera: [] for camera in CAMERAS}
    before: Moment | None = None
    pair: list[bytes] = []
    for moment in moments:
        if stop.is_set():
            raise StoppedError("the episode was given up")
        if moment is not before:
            state, objects = before = moment
            pair = renderer.files(state, CAMERAS, objects)
        for camera, file in zip(CAMERAS, pair, strict=True):
            files[camera].append(file)
    return files
