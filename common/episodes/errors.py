"""Root of the exceptions about episodes."""

from common.errors import TrillError


class EpisodeError(TrillError):
    """An episode file or a data set cannot be read, or is not what it should be."""
