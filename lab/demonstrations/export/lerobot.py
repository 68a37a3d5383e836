"""Writes episodes as a directory in lerobot's format v3.0.

::

    meta/info.json                          rate, features and their names
    meta/stats.json                         statistics by which training code normalises
    meta/tasks.parquet                      goals as sentences
    meta/episodes/chunk-000/file-000.parquet    where each episode is; seed, verdict, statistics
    meta/modality.json                      parts of state and action, for GR00T
    meta/trill.json                         how the episodes were made; the cameras
    data/chunk-000/file-000.parquet         a row for each frame
    videos/observation.images.left/chunk-000/file-000.mp4    and right
"""

import json
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from common.episodes.columns import CAMERAS, RATE
from common.episodes.episode_file import Episode
from lab.demonstrations.export import lerobot_layout as layout
from lab.demonstrations.export.card import card
from lab.demonstrations.export.fields import read_columns
from lab.demonstrations.export.lerobot_tables import DataTables
from lab.demonstrations.export.selection import ExportInput, SelectedEpisode, open_selected
from lab.demonstrations.export.staging import staged
from lab.demonstrations.export.stats import (
    PICTURE_STRIDE,
    PictureStats,
    Stats,
    column_stats,
    rare_columns,
)
from lab.demonstrations.export.video import VideoFiles, VideoSegment
from lab.errors import DatasetError

CRF = 18
"""Default quality of the videos; lower is better and larger."""
_BLOCK = 64
"""Number of frames that are in memory at a time, with their pictures."""
_MADE_FROM = "meta/trill.json"


def is_lerobot(path: Path) -> bool:
    """Whether a directory is an export of this module, not any data set in this format."""
    try:
        about = json.loads((path / layout.INFO_PATH).read_text())
    except (OSError, ValueError):
        return False
    ours = isinstance(about, dict) and "codebase_version" in about
    return ours and (path / _MADE_FROM).is_file()


def how_to_use(out: Path) -> str:
    """Return a line that says how to load the export."""
    return f"to load it: LeRobotDataset({f'trill/{out.name}'!r}, root={str(out)!r})"


def write(
    source: ExportInput,
    out: Path,
    *,
    force: bool = False,
    video: bool = True,
    crf: int = CRF,
    on_episode: Callable[[], None] = lambda: None,
) -> list[str]:
    """Write the directory, whole or not at all; return what the user should know of it.

    Args:
        source: the episodes.
        out: the directory.
        force: whether to replace an earlier export.
        video: whether pictures become mp4 files; otherwise they are inside the tables, lossless.
        crf: quality of the videos, 0 best to 51.
        on_episode: called after each episode.

    Raises:
        DatasetError: it cannot be written.
        EpisodeError: an episode cannot be read.
    """
    with staged(out, force=force, ours=is_lerobot) as root, ExitStack() as open_files:
        root.mkdir()
        videos = {}
        if video and source.size is not None:
            for camera, key in layout.PICTURE_KEYS.items():
                limit = layout.VIDEO_MB << 20
                folder = root / f"videos/{key}/chunk-000"
                videos[camera] = VideoFiles(folder, source.size, RATE, crf=crf, limit=limit)
                open_files.callback(videos[camera].close)
        features = layout.features(source.columns, source.size, video=video)
        writer = _Writer(source, root, features, videos)
        open_files.callback(writer.tables.close)
        for selected in source.episodes:
            with open_selected(selected) as episode:
                writer.add(selected, episode)
            on_episode()
        open_files.close()
        return writer.finish()


class _Writer:
    """Writes one episode after the other, then what describes them."""

    def __init__(
        self,
        source: ExportInput,
        root: Path,
        features: dict[str, dict[str, Any]],
        videos: dict[str, VideoFiles],
    ) -> None:
        self._source, self._root, self._features, self._videos = source, root, features, videos
        self.tables = DataTables(root, layout.schema(features))
        self._rows: list[dict[str, Any]] = []
        self._cameras = CAMERAS if source.size is not None else ()
        self._picture_stats = {camera: PictureStats() for camera in self._cameras}
        self._frames = 0
        self._goals = list(source.goals.values())
        if len(set(self._goals)) < len(self._goals):
            raise DatasetError(f"two tasks have the same goal: {self._goals}")

    def add(self, selected: SelectedEpisode, episode: Episode) -> None:
        """Append an episode."""
        self.tables.begin_episode()
        for video in self._videos.values():
            video.begin_episode()
        numbers = self._numbers(selected, episode)
        stats = {key: column_stats(values) for key, values in numbers.items()}
        picture_stats = {camera: PictureStats() for camera in self._cameras}
        for begin in range(0, selected.frames, _BLOCK):
            block = range(begin, min(begin + _BLOCK, selected.frames))
            columns = {key: values[block.start : block.stop] for key, values in numbers.items()}
            for camera, counted in picture_stats.items():
                columns |= self._pictures(camera, episode, block, counted)
            self.tables.add(columns)
        for camera, counted in picture_stats.items():
            stats[layout.PICTURE_KEYS[camera]] = counted.stats()
            self._picture_stats[camera].merge(counted)
        segments = {camera: video.end_episode() for camera, video in self._videos.items()}
        self._rows.append(self._row(selected, segments, stats))
        self._frames += selected.frames

    def _numbers(self, selected: SelectedEpisode, episode: Episode) -> dict[str, Any]:
        """Return the numbers of an episode's frames, by key."""
        count = selected.frames
        frames, indices, reward = slice(0, count), np.arange(count), selected.rewards()
        return {
            layout.STATE_KEY: read_columns(self._source.columns.state, episode, frames),
            layout.ACTION_KEY: read_columns(self._source.columns.action, episode, frames),
            **{key: age.read(episode, frames)[:, 0] for key, age in layout.AGE_KEYS.items()},
            "next.reward": reward,
            "next.done": indices == count - 1,
            "next.success": reward > 0,
            "timestamp": (indices / RATE).astype(np.float32),
            "frame_index": indices,
            "episode_index": np.full(count, len(self._rows)),
            "index": self._frames + indices,
            "task_index": np.full(count, self._source.tasks.index(selected.meta.task)),
        }

    def _pictures(
        self, camera: str, episode: Episode, block: range, stats: PictureStats
    ) -> dict[str, Any]:
        """Add pictures to the video or return them as a column; count every fourth."""
        video, embedded = self._videos.get(camera), []
        for frame in block:
            counted = frame % PICTURE_STRIDE == 0
            if video is None and not self._source.resized:
                # As collected: encoding a picture again would lose quality or enlarge it.
                jpeg = episode.jpeg(camera, frame)
                embedded.append({"bytes": jpeg, "path": f"{frame:06d}.jpg"})
                if not counted:
                    continue
            picture = self._source.picture(episode, camera, frame)
            if counted:
                stats.add(picture)
            if video is not None:
                video.add(picture)
            elif self._source.resized:
                _, png = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
                embedded.append({"bytes": png.tobytes(), "path": f"{frame:06d}.png"})
        return {layout.PICTURE_KEYS[camera]: embedded} if embedded else {}

    def _row(
        self, selected: SelectedEpisode, segments: dict[str, VideoSegment], stats: dict[str, Stats]
    ) -> dict[str, Any]:
        """Return the episode's row in the table of episodes."""
        meta = selected.meta
        row: dict[str, Any] = {
            "episode_index": len(self._rows),
            "tasks": [meta.goal],
            "length": selected.frames,
            "data/chunk_index": 0,
            "data/file_index": self.tables.file,
            "dataset_from_index": self._frames,
            "dataset_to_index": self._frames + selected.frames,
        }
        for camera, segment in segments.items():
            key = f"videos/{layout.PICTURE_KEYS[camera]}"
            row[f"{key}/chunk_index"], row[f"{key}/file_index"] = 0, segment.file
            row[f"{key}/from_timestamp"] = segment.begin
            row[f"{key}/to_timestamp"] = segment.end
        row |= {"seed": meta.seed, "success": meta.success, "verdict": meta.verdict}
        row |= {"operator": meta.operator, "task_name": meta.task}
        for key, values in stats.items():
            row |= {f"stats/{key}/{name}": value for name, value in values.items()}
        return row

    def finish(self) -> list[str]:
        """Write everything but the frames; return what the user should know."""
        columns = self._source.columns
        stats, notes = {}, []
        for key, about in self._features.items():
            if about["dtype"] not in {"video", "image"}:
                values = self.tables.read(key)
                stats[key] = column_stats(values)
                if key in {layout.STATE_KEY, layout.ACTION_KEY}:
                    notes += _rare(key, about["names"], rare_columns(values))
        stats |= {layout.PICTURE_KEYS[c]: seen.stats() for c, seen in self._picture_stats.items()}
        info = layout.info(
            self._features, episodes=len(self._rows), frames=self._frames, tasks=len(self._goals)
        )
        layout.write_json(self._root / layout.INFO_PATH, info)
        layout.write_json(self._root / layout.STATS_PATH, stats)
        modality = layout.modality(columns, self._source.size)
        layout.write_json(self._root / layout.MODALITY_PATH, modality)
        layout.write_tasks(self._root / layout.TASKS_PATH, self._goals)
        layout.write_episodes(self._root, self._rows)
        # In a file beside info.json, because lerobot refuses keys there that it does not know.
        episodes = [selected.meta.model_dump(mode="json") for selected in self._source.episodes]
        made_from = {
            "operators": self._source.operators,
            "state": columns.parts,
            "gait": columns.gait,
            "cameras": self._described_cameras(),
            "episodes": episodes,
        }
        layout.write_json(self._root / _MADE_FROM, made_from)
        (self._root / "README.md").write_text(card(self._source), encoding="utf-8")
        return notes

    def _described_cameras(self) -> list[dict[str, Any]]:
        """Return the cameras for each size at which pictures were collected."""
        if self._source.size is None:
            return []
        sizes = dict.fromkeys(selected.meta.picture_size for selected in self._source.episodes)
        return [
            {"collected_at": size, **_as_json(self._source.cameras(size))} for size in sizes if size
        ]


def _as_json(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _as_json(part) for key, part in value.items()}
    return value.tolist() if isinstance(value, np.ndarray) else value


def _rare(key: str, names: list[str], columns: list[int]) -> list[str]:
    if not columns:
        return []
    return [
        f"{key}: {', '.join(names[column] for column in columns)} "
        "hardly ever changes, so q01 and q99 coincide; the statistics have min and max in their "
        "place. For the gait, --gait held gives more to learn from"
    ]
