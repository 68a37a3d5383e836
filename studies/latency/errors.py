"""What goes wrong in the latency study."""

from common.errors import TrillError


class LatencyStudyError(TrillError):
    """The study cannot be run, read or drawn."""


class StoppedError(LatencyStudyError):
    """A trial under way was given up because the user wants to end."""
