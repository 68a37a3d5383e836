"""Shows the status of a running recording on the terminal, and warns of a full disk."""

import logging
import shutil
import time
from typing import TextIO

from services.logger.record.recorder import Recorder
from services.logger.record.units import format_duration, format_size

_log = logging.getLogger("trill.logger")

PERIOD = 0.5
"""Time between status lines [s]."""
_WARN_PERIOD = 60.0


class Status:
    """Rewrites one status line, and warns when the disk is nearly full.

    Attributes:
        is_full: whether less than ``min_free`` bytes were free at last.
    """

    def __init__(
        self, recorder: Recorder, low_disk: int, stream: TextIO, *, live: bool, min_free: int = 0
    ) -> None:
        """Show ``recorder`` on ``stream``; without ``live`` only warn."""
        self.is_full = False
        self._min_free = min_free
        self._recorder = recorder
        self._low_disk = low_disk
        self._stream = stream
        self._live = live
        self._began = self._then = time.monotonic()
        self._messages = self._bytes = 0
        self._warned_at = -_WARN_PERIOD
        self._width = 0

    def update(self, now: float) -> None:
        """Write the line if it is due; ``now`` is monotonic [s]."""
        if now - self._then < PERIOD:
            return
        free = shutil.disk_usage(self._recorder.path.parent).free
        self.is_full = free < self._min_free
        messages, size = self._recorder.messages, self._recorder.bytes
        seconds = now - self._then
        rate = (size - self._bytes) / seconds
        if free < self._low_disk and now - self._warned_at >= _WARN_PERIOD:
            self._warned_at = now
            self.end()
            _log.warning("%s", low_disk_text(free, rate, str(self._recorder.path.parent)))
        if self._live:
            line = status_line(
                self._recorder, now - self._began, (messages - self._messages) / seconds, rate, free
            )
            self._stream.write("\r" + line.ljust(self._width))
            self._stream.flush()
            self._width = len(line)
        self._then, self._messages, self._bytes = now, messages, size

    def end(self) -> None:
        """End the line, so that later output does not overwrite it."""
        if self._width:
            self._stream.write("\n")
            self._stream.flush()
            self._width = 0


def status_line(recorder: Recorder, seconds: float, messages: float, rate: float, free: int) -> str:
    """Return one line: time, rates, size, losses, free disk space, the running episode."""
    running = recorder.episodes.open
    episode = "" if running is None else f"  episode {running.episode} {running.label}".rstrip()
    return (
        f"{format_duration(seconds)}  {messages:.0f} msg/s  {format_size(rate)}/s  "
        f"{format_size(recorder.bytes)}  lost {recorder.lost}  "
        f"dropped {recorder.intake.dropped}  free {format_size(free)}{episode}"
    )


def low_disk_text(free: int, rate: float, where: str) -> str:
    """Return the warning, with the time left at the present rate [bytes/s]."""
    left = f", at this rate for {format_duration(free / rate)}" if rate > 0 else ""
    return (
        f"the disk is nearly full: {format_size(free)} free in {where}{left}; when it is full the "
        "recording ends, and what was written stays readable"
    )
