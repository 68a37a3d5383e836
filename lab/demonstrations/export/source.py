"""The episodes to export: which ones, which frames of them, and their pictures at the size wanted.

One episode is open at a time and one picture decoded at a time, however large the data set.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from common.episodes.episode_file import (
    PERIOD_NS,
    RATE,
    Episode,
    EpisodeMeta,
    Image,
    open_episode,
)
from common.episodes.errors import EpisodeError
from common.episodes.folder import DAMAGED, EPISODES, is_dataset, read_meta, trial_files
from lab.errors import DatasetError


@dataclass(frozen=True)
class EpisodeSelection:
    """What to take of one or several data sets.

    Attributes:
        roots: the data sets.
        seeds: only these, from the first up to but without the second; None: open on that side.
        failures: also episodes that are no success, if they were kept.
        tail: also frames after the judge had spoken.
        width: of the pictures [pixels]; None: as they are, or by the height.
        height: the same.
        pictures: whether pictures are wanted.
    """

    roots: tuple[Path, ...]
    seeds: tuple[int | None, int | None] = (None, None)
    failures: bool = False
    tail: bool = False
    width: int | None = None
    height: int | None = None
    pictures: bool = True

    def _takes(self, meta: EpisodeMeta) -> bool:
        first, end = self.seeds
        return (
            (meta.success or self.failures)
            and (first is None or meta.seed >= first)
            and (end is None or meta.seed < end)
        )

    def frames(self, meta: EpisodeMeta) -> int:
        """How many frames of an episode are taken."""
        if self.tail or meta.verdict_frame < 0:
            return meta.frames
        return min(meta.frames, meta.verdict_frame)


@dataclass(frozen=True)
class SelectedEpisode:
    """An episode to export.

    Attributes:
        path: its file.
        meta: what is known of it.
        frames: how many of its frames, from the first.
    """

    path: Path
    meta: EpisodeMeta
    frames: int

    def rewards(self) -> "np.ndarray[tuple[int], np.dtype[np.float32]]":
        """1 from the frame on whose action the judge called a success, before that 0: (frames,)."""
        reward = np.zeros(self.frames, dtype=np.float32)
        if self.meta.success:
            done = self.meta.verdict_frame if self.meta.verdict_frame > 0 else self.frames
            reward[min(done, self.frames) - 1 :] = 1.0
        return reward


@dataclass(frozen=True)
class Source:
    """Episodes of one kind, ready to be read one by one.

    Attributes:
        episodes: in the order of the data sets, then of the seeds.
        size: width and height of the exported pictures; None: without.
        original: width and height as collected; None: without.
    """

    episodes: tuple[SelectedEpisode, ...]
    size: tuple[int, int] | None
    original: tuple[int, int] | None

    @property
    def frames(self) -> int:
        """In all."""
        return sum(chosen.frames for chosen in self.episodes)

    @property
    def tasks(self) -> tuple[str, ...]:
        """Each once, in the order of the episodes."""
        return tuple(dict.fromkeys(chosen.meta.task for chosen in self.episodes))

    @property
    def goals(self) -> dict[str, str]:
        """Goal of each task as a sentence, in the order of the episodes."""
        return {chosen.meta.task: chosen.meta.goal for chosen in self.episodes}

    @property
    def operators(self) -> dict[str, int]:
        """Number of episodes by who operated the robot."""
        return dict(Counter(chosen.meta.operator for chosen in self.episodes))

    @property
    def resized(self) -> bool:
        """Whether the pictures are not as collected."""
        return self.size != self.original

    def picture(self, episode: Episode, camera: str, frame: int) -> Image:
        """One picture (height, width, 3) RGB, at the size wanted."""
        picture = episode.picture(camera, frame)
        if self.size is None or picture.shape[1::-1] == self.size:
            return picture
        small = cv2.resize(picture, self.size, interpolation=cv2.INTER_AREA)
        return np.asarray(small, dtype=np.uint8)


def choose(choice: EpisodeSelection) -> Source:
    """Find the episodes.

    Raises:
        DatasetError: there are none, or they do not fit together.
        EpisodeError: a data set cannot be read.
    """
    chosen: list[SelectedEpisode] = []
    for root in choice.roots:
        chosen += _of_one(root, choice)
    if not chosen:
        raise DatasetError(_nothing(choice))
    _check_different(chosen)
    sizes = {_size(one.meta) for one in chosen}
    return Source(
        tuple(chosen),
        _wanted(choice, sizes) if choice.pictures else None,
        next(iter(sizes)) if len(sizes) == 1 else None,
    )


def _of_one(root: Path, choice: EpisodeSelection) -> Iterator[SelectedEpisode]:
    if not is_dataset(root):
        raise DatasetError(
            f"no data set in {root}: expected a directory with dataset.json and {EPISODES}/, as "
            "`trill collect` makes"
        )
    for path in trial_files(root):
        if path.suffix != ".h5":
            continue
        meta = read_meta(path)
        frames = choice.frames(meta)
        if choice._takes(meta) and frames > 0:
            yield SelectedEpisode(path, meta, frames)


def _check_different(chosen: Sequence[SelectedEpisode]) -> None:
    """An episode that is there twice would count twice, and be trained on and validated with."""
    seen: dict[str, SelectedEpisode] = {}
    for one in chosen:
        other = seen.setdefault(one.meta.model_dump_json(), one)
        if other is not one:
            raise DatasetError(
                f"{one.path} is the same episode as {other.path}; give each data set once, and of "
                "copies only one"
            )


def _nothing(choice: EpisodeSelection) -> str:
    roots = ", ".join(str(root) for root in choice.roots)
    first, end = ("" if seed is None else str(seed) for seed in choice.seeds)
    limits = [] if choice.seeds == (None, None) else [f"with seeds {first}:{end}"]
    limits += [] if choice.failures else ["that are successes (others: --failures)"]
    return f"nothing to export: no episodes {' '.join(limits)} in {roots}; see trill collect --info"


def _size(meta: EpisodeMeta) -> tuple[int, int] | None:
    return meta.picture_size


def _shown(size: tuple[int, int] | None) -> str:
    return f"{size[0]}x{size[1]}" if size else "none"


def _wanted(choice: EpisodeSelection, sizes: set[tuple[int, int] | None]) -> tuple[int, int] | None:
    """Size of the exported pictures; None: there are none."""
    width, height = choice.width, choice.height
    if len(sizes) > 1 and (None in sizes or not (width and height)):
        found = ", ".join(sorted(_shown(size) for size in sizes))
        raise DatasetError(
            f"the data sets have pictures of different sizes ({found}); give --width and --height, "
            "leave out those without, or give --pictures none"
        )
    if width and height and sizes != {None}:
        return width, height
    (original,) = sizes
    if original is None:
        if width or height:
            raise DatasetError("there are no pictures to be resized; leave out --width, --height")
        return None
    if width and not height:
        height = round(width * original[1] / original[0])
    elif height and not width:
        width = round(height * original[0] / original[1])
    return width or original[0], height or original[1]


@contextmanager
def reading(chosen: SelectedEpisode) -> Iterator[Episode]:
    """Open an episode, check that its frames are evenly spaced, and export it.

    Raises:
        DatasetError: they are not, or the episode cannot be read to its end or written.
        EpisodeError: it cannot be opened.
    """
    with open_episode(chosen.path) as episode:
        try:
            stamps = episode.array("time/robot_ns", slice(0, chosen.frames))
        except DAMAGED as error:
            raise _unreadable(chosen, error) from error
        places = stamps[0] + PERIOD_NS * np.arange(len(stamps))
        worst = int(np.argmax(np.abs(stamps - places)))
        tolerance = round(chosen.meta.frame_tolerance * 1e9)
        if abs(int(stamps[worst] - places[worst])) > tolerance:
            raise DatasetError(
                f"{chosen.path}: expected a frame every {1000 / RATE:g} ms, but frame {worst} is "
                f"{(stamps[worst] - places[worst]) * 1e-6:+.1f} ms off; both formats know nothing "
                "but evenly spaced frames, so this episode cannot be exported"
            )
        try:
            yield episode
        except (EpisodeError, KeyError, OSError) as error:
            raise _unreadable(chosen, error) from error


def _unreadable(chosen: SelectedEpisode, error: Exception) -> DatasetError:
    return DatasetError(
        f"{chosen.path} cannot be exported: {error}; if it is damaged, trill collect --check says "
        "so: move it away, and trill collect makes it again"
    )


def seeds(chosen: Sequence[SelectedEpisode]) -> str:
    """``0, 1, 2, 7``."""
    return ", ".join(str(one.meta.seed) for one in chosen)
