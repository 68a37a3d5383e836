"""A trial as a sheet of pictures, to look at what the operator does."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from common.schemas import PlantState, SceneState
from common.topics import PLANT_TRUTH, TASK_SCENE
from services.sim.render import FollowCamera, contact_sheet, render_states
from services.sim.scenes import SCENES
from services.sim.scenes.base import View
from services.sim.tasks import find_task
from studies.tasks.stack import TaskStack, TrialResult, TrialSpec

Moment = tuple[PlantState, SceneState]


def record(spec: TrialSpec) -> tuple[TrialResult, list[Moment]]:
    """Run a trial and keep robot and scene as they were, 50 times a second."""
    stack = TaskStack(spec)
    moments: list[Moment] = []
    things: list[SceneState] = []
    stack.runner.on_message(TASK_SCENE, things.append)

    def keep(state: PlantState) -> None:
        if things:
            moments.append((state, things[-1]))

    stack.runner.on_message(PLANT_TRUTH, keep)
    try:
        return stack.run(), moments
    finally:
        stack.runner.close()


def write_sheet(
    spec: TrialSpec,
    moments: Sequence[Moment],
    path: Path,
    *,
    pictures: int,
    columns: int,
    view: int,
) -> None:
    """Write evenly spaced moments as one PNG.

    Args:
        spec: the trial they are from.
        moments: in the order of time.
        path: of the PNG.
        pictures: how many.
        columns: pictures in a row.
        view: which of the scene's cameras.

    Raises:
        RenderingUnavailableError: there is no off-screen OpenGL.
    """
    scene = find_task(spec.task).scene
    chosen = [moments[i] for i in np.linspace(0, len(moments) - 1, pictures).astype(int)]
    frames = render_states(
        [state for state, _ in chosen],
        480,
        400,
        _camera(SCENES[scene].views[view]),
        scene=scene,
        objects=[things for _, things in chosen],
    )
    sheet = contact_sheet(list(frames), columns)
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR))


def _camera(view: View) -> FollowCamera:
    """The scene's view, carried along with the robot."""
    return FollowCamera(view.azimuth, view.elevation, view.distance, view.target[2], lag=0.0001)
