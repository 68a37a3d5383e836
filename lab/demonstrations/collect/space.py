"""How much disk a data set takes: from its episodes once there are some, a guess before."""

import shutil
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from common.episodes.episode_file import RATE
from common.episodes.errors import EpisodeError
from lab.demonstrations.collect.recipe import EpisodeConfig
from lab.demonstrations.collect.store import IndexLine
from services.sim.tasks import find_task

_QUALITY = (10, 30, 50, 70, 80, 90, 95, 100)
_DENSITY = (0.04, 0.07, 0.09, 0.12, 0.15, 0.20, 0.26, 0.42)
"""Bytes a pixel of JPEG by quality, about; scenes and sizes differ by a third either way."""
_ARRAYS = 1700.0
"""Bytes a frame without pictures."""
_OF_LIMIT = 0.45
"""A success takes about so much of a task's time limit (0.3 to 0.6)."""
_RESERVE = 50e6
"""Left to others on the disk [bytes]."""


@dataclass(frozen=True)
class Need:
    """Disk space that is still needed.

    Attributes:
        each: an episode [bytes].
        total: of those still to come [bytes].
        measured: from episodes that are there, not guessed.
    """

    each: float
    total: float
    measured: bool


def size(amount: float) -> str:
    """``6.0 MB`` or ``1.5 GB``."""
    return f"{amount * 1e-9:.1f} GB" if amount >= 1e9 else f"{amount * 1e-6:.1f} MB"


def guess(recipe: EpisodeConfig) -> float:
    """Bytes of an episode, right within a factor of two."""
    pictures = 0.0
    if recipe.eyes is not None:
        density = float(np.interp(recipe.eyes.quality, _QUALITY, _DENSITY))
        pictures = 2.0 * recipe.eyes.width * recipe.eyes.height * density
    return find_task(recipe.task).limit * _OF_LIMIT * RATE * (_ARRAYS + pictures)


def needed(recipe: EpisodeConfig, lines: Iterable[IndexLine], missing: int) -> Need:
    """What ``missing`` further successes take, besides the trials in ``lines``."""
    done = list(lines)
    successes = sum(line.meta.success for line in done)
    if not successes:
        each = guess(recipe)
        return Need(each, each * missing, False)
    # What is kept of failures, too, comes with each success.
    each = sum(line.bytes for line in done) / successes
    return Need(each, each * missing, True)


def free(path: Path) -> float:
    """Bytes that may be written below ``path``, which need not be there yet."""
    there = path.absolute()
    for place in (there, *there.parents):
        # Not there, no place for us, or no name: whoever writes will say so.
        with suppress(OSError):
            return float(shutil.disk_usage(place).free)
    return 0.0


def check_room(root: Path, need: Need) -> None:
    """Refuse what clearly does not fit.

    Raises:
        EpisodeError: not even half of a guess, or not all that was measured, fits.
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
