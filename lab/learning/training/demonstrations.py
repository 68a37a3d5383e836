"""Reads the demonstrations of a data set and divides them into those to learn from and others."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from common.episodes.episode_file import EpisodeMeta, open_episode
from common.episodes.folder import DATASET, is_dataset, trial_files
from lab.errors import TrainingError
from lab.learning.training.truth import TRUTH

NUMBERS = (
    "observation/poses",
    "observation/control_state",
    "observation/joint_sin_cos",
    "observation/joint_velocity",
    "observation/gripper_closure",
    "action/hands",
    "action/grasp",
    "action/locomotion",
    "action/neck",
)
"""Columns from which observations and targets are made."""


@dataclass(frozen=True)
class Demonstration:
    """A successful episode up to its verdict; after it there is nothing to be learned.

    Attributes:
        path: its file.
        meta: its metadata.
        arrays: its columns by path.
        digest: SHA-256 of the file.
    """

    path: Path
    meta: EpisodeMeta
    arrays: dict[str, Any]
    digest: str

    @property
    def frames(self) -> int:
        """Number of its frames."""
        return len(self.arrays["action/neck"])


def read_demonstrations(
    root: Path,
    task: str,
    advance: Callable[[], None] = lambda: None,
    count: int | None = None,
) -> list[Demonstration]:
    """Return the successful episodes of a data set, by seed.

    Args:
        root: folder of the data set.
        task: that the episodes have to be of.
        advance: called after each file.
        count: how many, the first by seed; None: all.

    Raises:
        TrainingError: there is no data set, it is of another task, or has too few successes.
        EpisodeError: a file is damaged.
    """
    found: list[Demonstration] = []
    for path in episode_files(root):
        if len(found) == count:
            break
        with open_episode(path) as episode:
            meta = episode.meta
            if meta.task != task:
                raise TrainingError(
                    f"expected demonstrations of {task} in {root}, got one of {meta.task}; give "
                    "its own data set with --data"
                )
            if meta.success:
                end = meta.verdict_frame if meta.verdict_frame > 0 else meta.frames
                arrays = {name: episode.array(name, slice(end)) for name in (*NUMBERS, *TRUTH)}
                digest = hashlib.sha256(path.read_bytes()).hexdigest()
                found.append(Demonstration(path, meta, arrays, digest))
        advance()
    if len(found) < (count or 2):
        wanted = f"{count}" if count else "at least two, one to learn from and one held out,"
        raise TrainingError(
            f"expected {wanted} successful episodes in {root}, got {len(found)}; collect more with "
            f"`trill collect {task}`"
        )
    return found


def episode_files(root: Path) -> list[Path]:
    """Return the files of the episodes in a data set, by seed.

    Raises:
        TrainingError: there is no data set.
    """
    if not is_dataset(root):
        raise TrainingError(
            f"no data set in {root}: expected a directory with {DATASET}, as `trill collect` "
            "makes; give one with --data"
        )
    return [path for path in trial_files(root) if path.suffix == ".h5"]


def digest_of(demonstrations: Sequence[Demonstration]) -> str:
    """Return a digest of the bytes of all episodes, whatever the folder is called."""
    return hashlib.sha256("\n".join(d.digest for d in demonstrations).encode()).hexdigest()


def divide(
    demonstrations: Sequence[Demonstration], part: float, seed: int
) -> tuple[list[Demonstration], list[Demonstration]]:
    """Return the episodes to learn from, and the ``part`` that is held out, drawn with ``seed``.

    Whole episodes are held out: neighbouring frames of one are nearly the same.
    """
    count = min(max(1, round(part * len(demonstrations))), len(demonstrations) - 1)
    held = set(np.random.default_rng(seed).permutation(len(demonstrations))[:count].tolist())
    return (
        [d for i, d in enumerate(demonstrations) if i not in held],
        [d for i, d in enumerate(demonstrations) if i in held],
    )
