"""An empty flat floor."""

from typing import Any

from services.sim.scenes.base import Scene


def _build(_spec: Any) -> None:
    """Nothing beside the floor."""


SCENE = Scene(name="flat", doc="empty flat floor", build=_build)
