"""The scenes: one module each, registered here."""

from services.sim.errors import SceneError
from services.sim.scenes import bench, cap, door, flat, tool
from services.sim.scenes.base import Scene

__all__ = ["SCENES", "Scene", "find_scene"]

SCENES: dict[str, Scene] = {
    scene.name: scene for scene in (flat.SCENE, door.SCENE, bench.SCENE, tool.SCENE, cap.SCENE)
}
"""Every scene by name."""


def find_scene(name: str) -> Scene:
    """Return the scene called ``name``.

    Raises:
        SceneError: there is no such scene.
    """
    try:
        return SCENES[name]
    except KeyError:
        raise SceneError(f"unknown scene {name!r}: expected one of {sorted(SCENES)}") from None
