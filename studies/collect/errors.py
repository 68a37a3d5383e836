"""What goes wrong when collecting."""

from common.errors import TrillError


class CollectError(TrillError):
    """Demonstrations cannot be collected, read or shown."""


class StoppedError(CollectError):
    """An episode under way was given up because the user wants to end."""
