"""Disk space of a data set: measured from its episodes, or estimated before there are any."""

import shutil
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from common.episodes.columns import RATE
from common.episodes.errors import EpisodeError
from common.episodes.folder import IndexLine
from lab.demonstrations.collect.config import EpisodeConfig
from services.sim.tasks import find_task

_BYTES_PER_PIXEL = 0.2
"""About so much takes a JPEG picture of quality 90; scenes and sizes differ by a third."""
_ARRAYS = 1700.0
"""The arrays of a frame take about so much [bytes]."""
_SHARE_OF_LIMIT = 0.45
"""A success takes about this share of a task's time limit (0.3 to 0.6)."""
_RESERVE = 50e6
"""So much is left to others on the disk [bytes]."""


@dataclass(frozen=True)
class Need:
    """Disk space that the episodes still to come need.

    Attributes:
        each: size of an episode [bytes].
        total: size of the episodes still to come [bytes].
        measured: whether this is measured from episodes, not estimated.
    """

    each: float
    total: float
    measured: bool


def size(amount: float) -> str:
    """Return a number of bytes as ``6.0 MB`` or ``1.5 GB``."""
    return f"{amount * 1e-9:.1f} GB" if amount >= 1e9 else f"{amount * 1e-6:.1f} MB"


def estimate(config: EpisodeConfig) -> float:
    """Estimate the size of an episode within a factor of two [bytes]."""
    pictures = 0.0
    if config.pictures is not None:
        pictures = 2.0 * config.pictures.width * config.pictures.height * _BYTES_PER_PIXEL
    return find_task(config.task).limit * _SHARE_OF_LIMIT * RATE * (_ARRAYS + pictures)


def needed(config: EpisodeConfig, lines: Iterable[IndexLine], missing: int) -> Need:
    """Return what ``missing`` further successes take, given the trials in ``lines``."""
    done = list(lines)
    successes = sum(line.meta.success for line in done)
    if not successes:
        each = estimate(config)
        return Need(each, each * missing, False)
    # Failures that are kept come along with each success.
    each = sum(line.bytes for line in done) / successes
    return Need(each, each * missing, True)


def free(path: Path) -> float:
    """Return how much may be written below ``path``, which need not exist [bytes]."""
    there = path.absolute()
    for place in (there, *there.parents):
        # If the path is unusable, writing to it will say so.
        with suppress(OSError):
            return float(shutil.disk_usage(place).free)
    return 0.0


def check_room(root: Path, need: Need) -> None:
    """Refuse what clearly does not fit.

    Raises:
        EpisodeError: not even half of an estimate, or not all of what was measured, fits.
    """
    room = free(root) - _RESERVE
    least = need.total if need.measured else need.total / 2
    if need.total and least > room:
        raise EpisodeError(
            f"the disk is too small: {root} has {size(max(0.0, room))} to spare, the "
            f"episodes to come take about {size(need.total)} ({size(need.each)} "
            "each); make room, ask for fewer --episodes, smaller --width and --height, lower "
            "--quality or --no-images, or choose an --out on another disk"
        )
