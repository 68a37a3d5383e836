"""Root of the exceptions raised while starting, watching and reporting on a system."""

from common.errors import TrillError


class DeployError(TrillError):
    """Something about running the services together went wrong."""
