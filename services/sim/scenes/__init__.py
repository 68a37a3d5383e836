"""Registry of the scenes."""

from services.sim.errors import SceneError
from services.sim.scenes import bench, cap, door, tool
from services.sim.scenes.base import Scene

__all__ = ["SCENES", "Scene", "find_scene"]

FLAT = Scene(name="flat", doc="empty flat floor", build=lambda _spec: None)
SCENES: dict[str, Scene] = {
    scene.name: scene for scene in (FLAT, door.SCENE, bench.SCENE, tool.SCENE, cap.SCENE)
}
"""Every scene by name."""


def find_scene(name: str) -> Scene:
    """Return the scene called ``name``.

    Raises:
        SceneError: the scene is unknown.
    """
    try:
        return SCENES[name]
    except KeyError:
        raise SceneError(f"unknown scene {name!r}: expected one of {sorted(SCENES)}") from None
