"""Selects the episodes to export, their frames, and the size of their pictures.

One episode is open and one picture decoded at a time, however large the data set is.
"""

import json
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from common.episodes.columns import RATE
from common.episodes.episode_file import (
    PERIOD_NS,
    Episode,
    EpisodeMeta,
    Image,
    camera_attributes,
    open_episode,
)
from common.episodes.errors import EpisodeDamagedError, EpisodeError
from common.episodes.folder import DATASET, EPISODES, is_dataset, read_meta, trial_files
from common.robot.cameras import stereo_pair
from lab.demonstrations.export.fields import ExportColumns
from lab.errors import DatasetError

Size = tuple[int, int]
"""Width and height [pixels]."""


@dataclass(frozen=True)
class EpisodeSelection:
    """Says which part of one or several data sets is exported.

    Attributes:
        roots: folders of the data sets.
        seeds: first seed, and the seed after the last; None: no limit on that side.
        failures: whether to export kept episodes that are no success, too.
        tail: whether to export the frames after the verdict, too.
        width: width of the pictures [pixels]; None: as collected, or in proportion to the height.
        height: height of the pictures [pixels]; None: as collected, or in proportion to the width.
        pictures: whether to export pictures.
        columns: the exported numbers.
    """

    roots: tuple[Path, ...]
    seeds: tuple[int | None, int | None] = (None, None)
    failures: bool = False
    tail: bool = False
    width: int | None = None
    height: int | None = None
    pictures: bool = True
    columns: ExportColumns = field(default_factory=ExportColumns)

    def includes(self, meta: EpisodeMeta) -> bool:
        """Whether an episode with this metadata is exported."""
        first, end = self.seeds
        return (
            (meta.success or self.failures)
            and (first is None or meta.seed >= first)
            and (end is None or meta.seed < end)
            and self.frames(meta) > 0
        )

    def frames(self, meta: EpisodeMeta) -> int:
        """Return the number of frames of an episode that are exported."""
        if self.tail or meta.verdict_frame < 0:
            return meta.frames
        return min(meta.frames, meta.verdict_frame)


@dataclass(frozen=True)
class SelectedEpisode:
    """An episode to export.

    Attributes:
        path: its file.
        meta: its metadata.
        frames: number of its frames that are exported, from the first.
    """

    path: Path
    meta: EpisodeMeta
    frames: int

    def rewards(self) -> "np.ndarray[tuple[int], np.dtype[np.float32]]":
        """Return the rewards (frames,): 0, and 1 from the action that brought the success on."""
        reward = np.zeros(self.frames, dtype=np.float32)
        if self.meta.success:
            done = self.meta.verdict_frame if self.meta.verdict_frame > 0 else self.frames
            reward[min(done, self.frames) - 1 :] = 1.0
        return reward


@dataclass(frozen=True)
class ExportInput:
    """The episodes to export.

    Attributes:
        episodes: in the order of the data sets, then of the seeds.
        size: size of the exported pictures; None: there are none.
        original: size of the pictures as collected; None: there are none, or several sizes.
        columns: the exported numbers.
        notes: what the user should know of the data sets.
    """

    episodes: tuple[SelectedEpisode, ...]
    size: Size | None
    original: Size | None
    columns: ExportColumns
    notes: tuple[str, ...] = ()

    @property
    def frames(self) -> int:
        """Number of exported frames."""
        return sum(selected.frames for selected in self.episodes)

    @property
    def tasks(self) -> tuple[str, ...]:
        """Names of the tasks in the order of the episodes."""
        return tuple(dict.fromkeys(selected.meta.task for selected in self.episodes))

    @property
    def goals(self) -> dict[str, str]:
        """Goal of each task as a sentence, in the order of the episodes."""
        return {selected.meta.task: selected.meta.goal for selected in self.episodes}

    @property
    def operators(self) -> dict[str, int]:
        """Number of episodes by who operated the robot."""
        return dict(Counter(selected.meta.operator for selected in self.episodes))

    @property
    def resized(self) -> bool:
        """Whether pictures are exported at another size than collected."""
        return self.size != self.original

    def cameras(self, collected: Size) -> dict[str, dict[str, Any]]:
        """Return what describes the cameras of pictures that were ``collected`` at a size."""
        return {
            side: camera_attributes(camera, collected, self.size)
            for side, camera in stereo_pair().items()
        }

    def picture(self, episode: Episode, camera: str, frame: int) -> Image:
        """Return one picture (height, width, 3) RGB at the size of the export."""
        picture = episode.picture(camera, frame)
        if self.size is None or picture.shape[1::-1] == self.size:
            return picture
        small = cv2.resize(picture, self.size, interpolation=cv2.INTER_AREA)
        return np.asarray(small, dtype=np.uint8)


def select_episodes(selection: EpisodeSelection) -> ExportInput:
    """Find the selected episodes.

    Raises:
        DatasetError: there are none, or they do not fit together.
        EpisodeError: a data set cannot be read.
    """
    found: list[SelectedEpisode] = []
    notes: list[str] = []
    for root in selection.roots:
        if not is_dataset(root):
            raise DatasetError(
                f"no data set in {root}: expected a directory with dataset.json and {EPISODES}/, "
                "as `trill collect` makes"
            )
        paths = [path for path in trial_files(root) if path.suffix == ".h5"]
        metas = [read_meta(path) for path in paths]
        found += [
            SelectedEpisode(path, meta, selection.frames(meta))
            for path, meta in zip(paths, metas, strict=True)
            if selection.includes(meta)
        ]
        notes += _unfinished(root, sum(meta.success for meta in metas))
    if not found:
        raise DatasetError(_nothing(selection))
    _check_different(found)
    sizes = {selected.meta.picture_size for selected in found}
    return ExportInput(
        tuple(found),
        _export_size(selection, sizes) if selection.pictures else None,
        next(iter(sizes)) if len(sizes) == 1 else None,
        selection.columns,
        tuple(notes),
    )


def _unfinished(root: Path, successes: int) -> list[str]:
    """Return a note if a data set has fewer successes than its last run was to reach."""
    try:
        # Not its model: that needs the simulator's packages, which an export does not.
        wanted = json.loads((root / DATASET).read_bytes()).get("wanted", 0)
    except (OSError, ValueError, AttributeError) as error:
        raise EpisodeError(f"{root / DATASET} cannot be read: {error}") from error
    if not isinstance(wanted, int) or successes >= wanted:
        return []
    return [
        f"{root} is not finished: {successes} of {wanted} successes; trill collect goes on, and "
        "this export has only what is there"
    ]


def _check_different(episodes: Sequence[SelectedEpisode]) -> None:
    """Refuse an episode that is there twice: training and validation sets could both get it."""
    seen: dict[str, SelectedEpisode] = {}
    for selected in episodes:
        other = seen.setdefault(selected.meta.model_dump_json(), selected)
        if other is not selected:
            raise DatasetError(
                f"{selected.path} is the same episode as {other.path}; give each data set once, "
                "and of copies only one"
            )


def _nothing(selection: EpisodeSelection) -> str:
    roots = ", ".join(map(str, selection.roots))
    first, end = ("" if seed is None else str(seed) for seed in selection.seeds)
    limits = [] if selection.seeds == (None, None) else [f"with seeds {first}:{end}"]
    limits += [] if selection.failures else ["that are successes (others: --failures)"]
    return f"nothing to export: no episodes {' '.join(limits)} in {roots}; see trill collect --info"


def _export_size(selection: EpisodeSelection, sizes: set[Size | None]) -> Size | None:
    """Return the size of the exported pictures, given the sizes of the collected ones."""
    width, height = selection.width, selection.height
    if sizes == {None}:
        if width or height:
            raise DatasetError("there are no pictures to be resized; leave out --width, --height")
        return None
    if None not in sizes and width and height:
        return width, height
    if len(sizes) > 1:
        found = sorted(f"{size[0]}x{size[1]}" if size else "none" for size in sizes)
        raise DatasetError(
            f"the data sets have pictures of different sizes ({', '.join(found)}); give --width "
            "and --height, leave out those without, or give --pictures none"
        )
    (original,) = sizes
    assert original is not None
    if width:
        return width, round(width * original[1] / original[0])
    return (round(height * original[0] / original[1]), height) if height else original


@contextmanager
def open_selected(selected: SelectedEpisode) -> Iterator[Episode]:
    """Open an episode for export, after a check that its frames are evenly spaced.

    Raises:
        DatasetError: they are not, or the file is damaged.
        EpisodeError: the file cannot be reached.
    """
    try:
        with open_episode(selected.path) as episode:
            _check_spacing(selected, episode)
            yield episode
    except EpisodeDamagedError as error:
        raise DatasetError(
            f"{selected.path} cannot be exported: {error}; check the data set with trill collect "
            "--check: if the file is damaged, move it away, and trill collect makes it again"
        ) from error


def _check_spacing(selected: SelectedEpisode, episode: Episode) -> None:
    stamps = episode.array("time/robot_ns", slice(0, selected.frames))
    offsets = stamps - (stamps[0] + PERIOD_NS * np.arange(len(stamps)))
    worst = int(np.argmax(np.abs(offsets)))
    if abs(int(offsets[worst])) > round(selected.meta.frame_tolerance * 1e9):
        raise DatasetError(
            f"{selected.path}: expected a frame every {1000 / RATE:g} ms, but frame {worst} is "
            f"{offsets[worst] * 1e-6:+.1f} ms off; both formats require evenly spaced frames, "
            "so this episode cannot be exported"
        )
