"""Root of the exceptions raised while starting and supervising a system."""

from common.errors import TrillError


class DeployError(TrillError):
    """The processes of a system cannot be started or supervised."""
