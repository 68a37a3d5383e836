"""Exceptions of the logger."""

from common.errors import TrillError


class LoggerError(TrillError):
    """Root of the logger's exceptions: recording or reading a log failed."""


class ExportError(LoggerError):
    """A log could not be exported or shown."""


class DamagedLogError(LoggerError):
    """A record of a log cannot be read; the text names the record and the cause, not the file."""
