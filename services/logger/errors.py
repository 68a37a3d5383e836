"""Exceptions of the logger."""

from common.errors import TrillError


class LoggerError(TrillError):
    """Root of the logger's exceptions: recording or reading a log failed."""
