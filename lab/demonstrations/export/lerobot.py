"""Writes episodes as a directory in lerobot's format v3.0.

::

    meta/info.json                          rate, features and their names
    meta/stats.json                         figures to scale by
    meta/tasks.parquet                      goals as sentences
    meta/episodes/chunk-000/file-000.parquet    where each episode is; seed, verdict, figures
    meta/trill.json                         how the episodes were made
    data/chunk-000/file-000.parquet         a row a frame
    videos/observation.images.left/chunk-000/file-000.mp4    and right
"""

import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from common.episodes.columns import CAMERAS
from common.episodes.episode_file import RATE, Episode
from lab.demonstrations.export import lerobot_layout as layout
from lab.demonstrations.export.card import card
from lab.demonstrations.export.fields import ACTION, STATE, join
from lab.demonstrations.export.lerobot_layout import Pictures
from lab.demonstrations.export.source import SelectedEpisode, Source, reading
from lab.demonstrations.export.staging import staged
from lab.demonstrations.export.stats import EVERY, PictureStats, Stats, of_columns
from lab.demonstrations.export.video import Place, VideoFiles
from lab.errors import DatasetError

CRF = 18
"""Quality of the videos; lower is better and larger."""
_BLOCK = 64
"""Frames a part of a table; bounds what is in memory where pictures are inside."""
_MADE_FROM = "meta/trill.json"

Tick = Callable[[int], None]


def is_lerobot(path: Path) -> bool:
    """Whether a directory is an export of ours, not somebody's own recordings in this format."""
    try:
        about = json.loads((path / layout.INFO_PATH).read_text())
    except (OSError, ValueError):
        return False
    ours = isinstance(about, dict) and "codebase_version" in about
    return ours and (path / _MADE_FROM).is_file()


def write(
    source: Source,
    out: Path,
    *,
    force: bool = False,
    video: bool = True,
    crf: int = CRF,
    tick: Tick = lambda _frames: None,
) -> None:
    """Write the directory, whole or not at all.

    Args:
        source: what to write.
        out: the directory.
        force: replace an earlier export.
        video: pictures as mp4; else inside the tables, without loss.
        crf: quality of the videos, 0 best to 51.
        tick: told how many frames are done, as they are.

    Raises:
        DatasetError: it cannot be written.
        EpisodeError: an episode cannot be read.
    """
    pictures = Pictures(source.size, video) if source.size is not None else None
    described = layout.features(pictures)
    with staged(out, force=force, ours=is_lerobot) as root, ExitStack() as open_files:
        root.mkdir()
        films = _films(root, pictures, crf) if pictures is not None and video else {}
        for film in films.values():
            open_files.callback(film.close)
        writer = _Writer(source, root, described, films)
        open_files.callback(writer.tables.close)
        for index, chosen in enumerate(source.episodes):
            with reading(chosen) as episode:
                for count in writer.add(index, chosen, episode):
                    tick(count)
        open_files.close()
        writer.finish()


def _films(root: Path, pictures: Pictures, crf: int) -> dict[str, VideoFiles]:
    limit = layout.VIDEO_MB << 20
    return {
        camera: VideoFiles(
            root / f"videos/{key}/chunk-000", pictures.size, RATE, crf=crf, limit=limit
        )
        for camera, key in layout.PICTURE_KEYS.items()
    }


class _Tables:
    """The data tables, one file after the other; a new one is begun only between episodes."""

    def __init__(self, root: Path, schema: pa.Schema) -> None:
        self._root, self._schema = root, schema
        self._writer: Any = None
        self.file = -1

    def path(self, file: int) -> Path:
        return self._root / layout.DATA_PATH.format(chunk_index=0, file_index=file)

    def begin_episode(self) -> None:
        """The next rows belong to another episode than the last."""
        if self._writer is None or self.path(self.file).stat().st_size > layout.DATA_MB << 20:
            self.close()
            self.file += 1
            self.path(self.file).parent.mkdir(parents=True, exist_ok=True)
            self._writer = pq.ParquetWriter(self.path(self.file), self._schema)

    def add(self, columns: dict[str, Any]) -> None:
        """Append rows."""
        arrays = [_array(columns[field.name], field.type) for field in self._schema]
        self._writer.write_table(pa.Table.from_arrays(arrays, schema=self._schema))

    def close(self) -> None:
        """Finish the file."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None

    def read(self, column: str) -> Any:
        """One column of all files, as numpy's array; after :meth:`close`."""
        paths = [self.path(file) for file in range(self.file + 1)]
        found = [pq.read_table(path, columns=[column])[column].combine_chunks() for path in paths]
        return np.concatenate([_numbers(array) for array in found])


def _array(values: Any, kind: pa.DataType) -> pa.Array:
    if pa.types.is_fixed_size_list(kind):
        flat = pa.array(values.reshape(-1), kind.value_type)
        return pa.FixedSizeListArray.from_arrays(flat, kind.list_size)
    return pa.array(values, kind)


def _numbers(array: Any) -> Any:
    if pa.types.is_fixed_size_list(array.type):
        return array.flatten().to_numpy().reshape(-1, array.type.list_size)
    return array.to_numpy(zero_copy_only=False)


@dataclass
class _Writer:
    """Adds episode after episode."""

    source: Source
    root: Path
    described: dict[str, dict[str, Any]]
    films: dict[str, VideoFiles]
    rows: list[dict[str, Any]] = field(default_factory=list)
    total: dict[str, PictureStats] = field(default_factory=dict)
    frames: int = 0

    def __post_init__(self) -> None:
        self.tables = _Tables(self.root, layout.schema(self.described))
        self._goals = list(self.source.goals.values())
        if len(set(self._goals)) < len(self._goals):
            raise DatasetError(f"two tasks have the same goal, in words: {self._goals}")

    def add(self, index: int, chosen: SelectedEpisode, episode: Episode) -> Iterator[int]:
        """Append an episode; yields the frames done by each step."""
        self.tables.begin_episode()
        for film in self.films.values():
            film.begin_episode()
        task = self.source.tasks.index(chosen.meta.task)
        numbers = _columns(chosen, episode, index=index, first=self.frames, task=task)
        figures = {key: of_columns(values) for key, values in numbers.items()}
        seen = (
            {camera: PictureStats() for camera in CAMERAS} if self.source.size is not None else {}
        )
        for begin in range(0, chosen.frames, _BLOCK):
            block = slice(begin, min(begin + _BLOCK, chosen.frames))
            columns = {key: values[block] for key, values in numbers.items()}
            for camera, counted in seen.items():
                columns |= self._pictures(camera, episode, block, counted)
            self.tables.add(columns)
            yield block.stop - block.start
        for camera, pictures in seen.items():
            figures[layout.PICTURE_KEYS[camera]] = pictures.stats()
            self.total.setdefault(camera, PictureStats()).merge(pictures)
        places = {
            layout.PICTURE_KEYS[camera]: film.end_episode() for camera, film in self.films.items()
        }
        self.rows.append(self._row(index, chosen, self._goals[task], places, figures))
        self.frames += chosen.frames

    def _pictures(
        self, camera: str, episode: Episode, block: slice, seen: PictureStats
    ) -> dict[str, Any]:
        """Film some pictures, or return them as a column; count every fourth."""
        embedded = []
        for frame in range(block.start, block.stop):
            counted, filmed = frame % EVERY == 0, camera in self.films
            if not filmed and not self.source.resized:
                # As collected: to decode and encode it again would lose, or be many times larger.
                jpeg = episode.jpeg(camera, frame)
                embedded.append({"bytes": jpeg, "path": f"{frame:06d}.jpg"})
                if not counted:
                    continue
            picture = self.source.picture(episode, camera, frame)
            if counted:
                seen.add(picture)
            if filmed:
                self.films[camera].add(picture)
            elif self.source.resized:
                _, png = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
                embedded.append({"bytes": png.tobytes(), "path": f"{frame:06d}.png"})
        return {layout.PICTURE_KEYS[camera]: embedded} if embedded else {}

    def _row(
        self,
        index: int,
        chosen: SelectedEpisode,
        goal: str,
        places: dict[str, Place],
        figures: dict[str, Stats],
    ) -> dict[str, Any]:
        row: dict[str, Any] = {
            "episode_index": index,
            "tasks": [goal],
            "length": chosen.frames,
            "data/chunk_index": 0,
            "data/file_index": self.tables.file,
            "dataset_from_index": self.frames,
            "dataset_to_index": self.frames + chosen.frames,
        }
        for key, place in places.items():
            row[f"videos/{key}/chunk_index"] = 0
            row[f"videos/{key}/file_index"] = place.file
            row[f"videos/{key}/from_timestamp"] = place.begin
            row[f"videos/{key}/to_timestamp"] = place.end
        meta = chosen.meta
        row |= {"seed": meta.seed, "success": meta.success, "verdict": meta.verdict}
        row |= {"operator": meta.operator, "task_name": meta.task}
        for key, stats in figures.items():
            row |= {f"stats/{key}/{name}": value for name, value in stats.items()}
        return row

    def finish(self) -> None:
        """Write everything but the frames."""
        stats: dict[str, Stats] = {}
        for key, about in self.described.items():
            if about["dtype"] not in {"video", "image"}:
                stats[key] = of_columns(self.tables.read(key))
        stats |= {layout.PICTURE_KEYS[camera]: seen.stats() for camera, seen in self.total.items()}
        content = layout.info(
            self.described, episodes=len(self.rows), frames=self.frames, tasks=len(self._goals)
        )
        layout.write_json(self.root / layout.INFO_PATH, content)
        layout.write_json(self.root / layout.STATS_PATH, stats)
        layout.write_tasks(self.root / layout.TASKS_PATH, self._goals)
        layout.write_episodes(self.root, self.rows)
        made = [chosen.meta.model_dump(mode="json") for chosen in self.source.episodes]
        # Beside info.json: lerobot takes nothing there that it does not know.
        about = {"operators": self.source.operators, "episodes": made}
        layout.write_json(self.root / _MADE_FROM, about)
        (self.root / "README.md").write_text(card(self.source), encoding="utf-8")


def _columns(
    chosen: SelectedEpisode, episode: Episode, *, index: int, first: int, task: int
) -> dict[str, Any]:
    """The numbers of an episode's frames, by key."""
    count = chosen.frames
    frames, places = slice(0, count), np.arange(count)
    reward = chosen.rewards()
    return {
        layout.STATE_KEY: join(STATE, episode, frames),
        layout.ACTION_KEY: join(ACTION, episode, frames),
        **{key: part.of(episode, frames)[:, 0] for key, part in layout.AGE_NAMES.items()},
        "next.reward": reward,
        "next.done": places == count - 1,
        "next.success": reward > 0,
        "timestamp": (places / RATE).astype(np.float32),
        "frame_index": places,
        "episode_index": np.full(count, index),
        "index": first + places,
        "task_index": np.full(count, task),
    }
