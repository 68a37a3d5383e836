"""From where a task is filmed, so that a stranger sees what is done."""

from typing import Final

from services.sim.rendering.render import FollowCamera
from services.sim.scenes import find_scene
from services.sim.scenes.base import View

Shot = View | FollowCamera

SHOTS: Final[dict[str, Shot]] = {
    "door/unlock": View((0.52, 0.20, 0.89), -50.0, -17.0, 1.35),
    "door/walk": View((0.15, 0.10, 0.76), -60.0, -18.0, 2.5),
    "door/push": View((0.85, 0.0, 0.74), -8.0, -30.0, 2.7),
    "bench/hammer": View((0.45, -0.30, 0.92), 68.0, -25.0, 1.7),
    "bench/walk": View((0.22, -0.45, 0.50), 35.0, -27.0, 3.8),
    "bench/push": View((0.65, -0.65, 0.62), 35.0, -26.0, 3.0),
    "hardware/tool": View((0.36, -0.08, 0.87), -150.0, -26.0, 1.2),
    "hardware/cap": View((0.35, 0.0, 0.93), -140.0, -20.0, 0.95),
}
"""Cameras of the tasks; one that is missing is filmed by its scene's first view."""


def shot_of(task: str, scene: str) -> Shot:
    """The camera that shows ``task`` best.

    Raises:
        SceneError: there is no such scene.
    """
    views = find_scene(scene).views
    return SHOTS.get(task) or (views[0] if views else FollowCamera())
