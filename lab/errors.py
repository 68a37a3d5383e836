"""Exceptions of what people do with the robot."""

from common.errors import TrillError


class LabError(TrillError):
    """Root: a run, a log, a data set or a study cannot be made, read or shown."""


class StoppedError(LabError):
    """A trial under way was given up because the user wants to end."""


class DatasetError(LabError):
    """A data set cannot be exported or checked."""


class LatencyStudyError(LabError):
    """The latency study cannot be run, read or drawn."""


class TrainingError(LabError):
    """A policy cannot be trained."""
