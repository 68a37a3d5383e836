"""Reads the demonstrations of a data set and divides them into those to learn from and others."""

import hashlib
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from common.episodes.episode_file import Episode, EpisodeMeta, open_episode
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
    "action/slip",
    "action/neck",
    "intervention",
)
"""Columns from which observations and targets are made."""


SHORTEST = 10
"""Frames of the shortest intervention that is learned from."""


@dataclass(frozen=True)
class Demonstration:
    """What a successful episode shows up to its verdict, or an intervention in one.

    Attributes:
        path: file of the episode.
        meta: metadata of the episode.
        arrays: its columns by path.
        digest: SHA-256 of the file.
        first: number of its first frame in the episode.
    """

    path: Path
    meta: EpisodeMeta
    arrays: dict[str, Any]
    digest: str
    first: int = 0

    @property
    def frames(self) -> int:
        """Number of its frames."""
        return len(self.arrays["action/neck"])


def read_demonstrations(
    roots: Sequence[Path],
    task: str,
    *,
    policy_frames: bool = False,
    count: int | None = None,
    advance: Callable[[], None] = lambda: None,
) -> list[Demonstration]:
    """Return what the successful episodes of data sets show, in the order of the sets and seeds.

    Args:
        roots: folders of the data sets.
        task: that the episodes have to be of.
        policy_frames: whether what policies did is shown, too.
        count: how many of each data set, the first by seed; None: all.
        advance: called after each file.

    Raises:
        TrainingError: there is no data set, one is of another task, or has too few successes to be
            learned from.
        EpisodeError: a file is damaged.
    """
    found: list[Demonstration] = []
    for root in roots:
        found += _of_one(root, task, policy_frames, count, advance)
    episodes = len({d.path for d in found})
    if episodes < 2:
        places = ", ".join(map(str, roots))
        raise TrainingError(
            f"expected at least two successful episodes in {places}, one to learn from and one "
            f"held out, got {episodes}; collect more with `trill collect {task}`"
            + ("" if policy_frames else "; what a policy does alone does not count")
        )
    return found


def _of_one(
    root: Path,
    task: str,
    policy_frames: bool,
    count: int | None,
    advance: Callable[[], None],
) -> list[Demonstration]:
    """Return what the first successful episodes of one data set show, by seed."""
    found: list[Demonstration] = []
    successes = 0
    for path in episode_files(root):
        if successes == count:
            break
        with open_episode(path) as episode:
            if episode.meta.task != task:
                raise TrainingError(
                    f"expected demonstrations of {task} in {root}, got one of "
                    f"{episode.meta.task}; give its own data set with --data"
                )
            if episode.meta.success:
                successes += 1
                found += _shown(path, episode, policy_frames)
        advance()
    if successes < (count or 0):
        raise TrainingError(
            f"expected {count} successful episodes in {root}, got {successes}; collect more with "
            f"`trill collect {task}`"
        )
    return found


def _shown(path: Path, episode: Episode, policy_frames: bool) -> list[Demonstration]:
    """Return what an episode shows: all of it, or what an operator did in place of a policy."""
    meta, digest = episode.meta, hashlib.sha256(path.read_bytes()).hexdigest()
    end = meta.verdict_frame if meta.verdict_frame > 0 else meta.frames
    arrays = {name: episode.array(name, slice(end)) for name in (*NUMBERS, *TRUTH)}
    whole = Demonstration(path, meta, arrays, digest)
    if policy_frames or meta.operator in {"synthetic", "person"}:
        return [whole]
    edges = np.flatnonzero(np.diff(arrays["intervention"], prepend=False, append=False))
    return [
        replace(whole, arrays={n: values[a:b] for n, values in arrays.items()}, first=a)
        for a, b in edges.reshape(-1, 2).tolist()
        if b - a >= SHORTEST
    ]


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
    """Return a digest of the bytes of all episodes, whatever the folders are called."""
    digests = dict.fromkeys(d.digest for d in demonstrations)
    return hashlib.sha256("\n".join(digests).encode()).hexdigest()


def divide(
    demonstrations: Sequence[Demonstration], part: float, seed: int
) -> tuple[list[Demonstration], list[Demonstration]]:
    """Return what to learn from, and the ``part`` of the episodes held out, drawn with ``seed``.

    Whole episodes are held out: neighbouring frames of one are nearly the same.
    """
    episodes = list(dict.fromkeys(d.path for d in demonstrations))
    count = min(max(1, round(part * len(episodes))), len(episodes) - 1)
    drawn = np.random.default_rng(seed).permutation(len(episodes))[:count].tolist()
    held = {episodes[i] for i in drawn}
    return (
        [d for d in demonstrations if d.path not in held],
        [d for d in demonstrations if d.path in held],
    )


def in_words(demonstrations: Sequence[Demonstration]) -> str:
    """Say who shows how much, for instance ``120 demonstrations (synthetic), 31 interventions``."""
    helped = [d for d in demonstrations if d.arrays["intervention"].any()]
    whole = Counter(d.meta.operator for d in demonstrations if not d.arrays["intervention"].any())
    parts = [f"{count} demonstrations ({name})" for name, count in sorted(whole.items())]
    if helped:
        share = sum(d.frames for d in helped) / sum(d.frames for d in demonstrations)
        parts.append(f"{len(helped)} interventions ({100 * share:.0f} % of the frames)")
    return ", ".join(parts)
