"""The files of a running recording: opens its segments and keeps them within their limits."""

import logging
import os
import shutil
from collections.abc import Mapping
from pathlib import Path

from services.logger.errors import LoggerError
from services.logger.log_format import write_error
from services.logger.read.locks import is_locked
from services.logger.read.segments import (
    existing_segments,
    find_segments,
    next_segment,
    origin_of,
    recording_id,
)
from services.logger.record.config import LoggerConfig
from services.logger.record.sink import McapSink
from services.logger.record.units import format_size

_log = logging.getLogger("trill.logger")


class RecordingFiles:
    """Opens one segment after the other, numbered upwards whatever happens to earlier ones.

    All carry the id of the recording: that of the segments already there, or else ``session``.
    """

    def __init__(
        self, path: Path, robot: str, config: LoggerConfig, session: str, about: Mapping[str, str]
    ) -> None:
        """Record ``robot`` to ``path`` and the segments behind it, with facts ``about`` it."""
        self._path, self._robot, self._config = path, robot, config
        self._number = 0
        recording = find_segments(path).recording or session
        self._about = {"recording": recording, "session": session, **about}

    def open_next(self) -> McapSink:
        """Open the next segment, and delete the oldest ones beyond the limits.

        Raises:
            LoggerError: it cannot be written.
        """
        path = next_segment(self._path, self._number)
        sink = McapSink(path, self._robot, self._config, self._about)
        self._number = int(
            path.stem.removeprefix(f"{self._path.stem}-") if path != self._path else 1
        )
        asked = ", ".join(f"{self._robot}/{topic}" for topic in self._config.topics)
        _log.info("recording %s to %s", asked or f"{self._robot}/**", path)
        self._delete_oldest(path)
        return sink

    def _delete_oldest(self, newest: Path) -> None:
        config = self._config
        if config.keep_size is None and config.keep_segments is None:
            return
        older = [path for path in existing_segments(self._path) if path != newest]
        # Only what surely is of this recording, and nobody is repairing.
        older = [path for path in older if self._is_ours(path) and not is_locked(path)]
        count = len(older) + 1
        # The new segment will grow to its full size.
        size = sum(path.stat().st_size for path in older) + (config.rotate_size or 0)
        for path in older:
            if count <= (config.keep_segments or count) and size <= (config.keep_size or size):
                return
            count, size = count - 1, size - path.stat().st_size
            path.unlink(missing_ok=True)
            _log.info("deleted %s: more than is to be kept", path)

    def _is_ours(self, path: Path) -> bool:
        return recording_id(origin_of(path) or {}) == self._about["recording"]


def make_directory(path: Path) -> None:
    """Make the directory of ``path`` before the bus is opened.

    Raises:
        LoggerError: it cannot be made or written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if not os.access(path.parent, os.W_OK):
            raise PermissionError(13, "Permission denied")
    except OSError as error:
        raise write_error(path, error) from error


def check_space(path: Path, min_free: int) -> None:
    """Make sure that the disk of ``path`` has ``min_free`` bytes of space left.

    Raises:
        LoggerError: it has not.
    """
    free = shutil.disk_usage(path.parent).free
    if free < min_free:
        raise LoggerError(
            f"the disk is full: {format_size(free)} free in {path.parent}, expected at least "
            f"{format_size(min_free)} ([logger] min_free); what was recorded before is whole. Free "
            "some space, or let --keep-size delete the oldest segments"
        )
