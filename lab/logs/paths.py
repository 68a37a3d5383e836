"""Finds the log of a run."""

from pathlib import Path

from deploy.system import LOG_FILE


def log_path(given: Path) -> Path:
    """Return the log file, given that or its run's directory."""
    return given / LOG_FILE if given.is_dir() else given
