"""Exceptions of the simulated plant."""

from common.errors import TrillError


class SimError(TrillError):
    """Root of the simulated plant's exceptions."""


class SceneError(SimError):
    """A scene is unknown or cannot be built."""


class StandError(SimError):
    """No standing pose exists for the requested height and stance width."""


class PlantDivergedError(SimError):
    """The physics produced a non-finite state."""


class RenderingUnavailableError(SimError):
    """No usable OpenGL library for off-screen rendering."""


class TaskError(SimError):
    """A task is unknown or does not fit its scene."""
