"""Exceptions of the export."""

from services.logger.errors import LoggerError


class ExportError(LoggerError):
    """A log could not be exported or shown."""
