"""Tables and descriptions of lerobot's format v3.0, as its own loader expects them."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from common.episodes.columns import CAMERAS, RATE
from lab.demonstrations.export.fields import AGES, ROBOT, ExportColumns, column_names, spans
from lab.demonstrations.export.selection import Size
from lab.demonstrations.export.video import CODEC, PIXEL_FORMAT

VERSION = "v3.0"
FILES_PER_CHUNK = 1000
DATA_MB, VIDEO_MB = 100, 200
"""A file that is larger gets no further episode."""
FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}"
DATA_PATH = f"data/{FILE}.parquet"
VIDEO_PATH = "videos/{video_key}/" + FILE + ".mp4"
EPISODES_PATH = f"meta/episodes/{FILE}.parquet"
INFO_PATH, STATS_PATH, TASKS_PATH = "meta/info.json", "meta/stats.json", "meta/tasks.parquet"
MODALITY_PATH = "meta/modality.json"
PICTURE_KEYS = {camera: f"observation.images.{camera}" for camera in CAMERAS}
STATE_KEY, ACTION_KEY = "observation.state", "action"
AGE_KEYS = {f"age.{age.names[0]}": age for age in AGES}
"""One number for each frame; not called observations, so that no policy uses them as such."""
COUNTERS = ("frame_index", "episode_index", "index", "task_index")
PICTURE = pa.struct([("bytes", pa.binary()), ("path", pa.string())])


def _feature(dtype: str, names: Sequence[str] | None = None) -> dict[str, Any]:
    shape = [len(names)] if names else [1]
    return {"dtype": dtype, "shape": shape, "names": list(names) if names else None}


def features(
    columns: ExportColumns, size: Size | None, *, video: bool
) -> dict[str, dict[str, Any]]:
    """Return the description of each value of a frame, by key.

    Args:
        columns: the chosen numbers.
        size: size of the pictures; None: there are none.
        video: whether pictures are mp4 files; otherwise they are inside the tables.
    """
    found = {
        STATE_KEY: _feature("float32", column_names(columns.state)),
        ACTION_KEY: _feature("float32", column_names(columns.action)),
    }
    if size is not None:
        found |= {key: _picture(*size, video=video) for key in PICTURE_KEYS.values()}
    found |= {key: _feature("float32") for key in AGE_KEYS}
    found |= {"next.reward": _feature("float32")}
    found |= {key: _feature("bool") for key in ("next.done", "next.success")}
    found |= {"timestamp": _feature("float32")}
    return found | {key: _feature("int64") for key in COUNTERS}


def _picture(width: int, height: int, *, video: bool) -> dict[str, Any]:
    about: dict[str, Any] = {
        "dtype": "video" if video else "image",
        "shape": [height, width, 3],
        "names": ["height", "width", "channels"],
    }
    if video:
        about["info"] = {
            "video.height": height,
            "video.width": width,
            "video.codec": CODEC,
            "video.pix_fmt": PIXEL_FORMAT,
            "video.is_depth_map": False,
            "video.fps": RATE,
            "video.channels": 3,
            "has_audio": False,
        }
    return about


def schema(described: Mapping[str, Mapping[str, Any]]) -> pa.Schema:
    """Return the schema of the data tables, which do not contain videos."""
    scalars = {"float32": pa.float32(), "int64": pa.int64(), "bool": pa.bool_()}
    fields = []
    for key, about in described.items():
        if about["dtype"] == "video":
            continue
        if about["dtype"] == "image":
            fields.append((key, PICTURE))
            continue
        scalar = scalars[about["dtype"]]
        vector = key in {STATE_KEY, ACTION_KEY}
        fields.append((key, pa.list_(scalar, about["shape"][0]) if vector else scalar))
    return pa.schema(fields)


def info(described: Mapping[str, Any], *, episodes: int, frames: int, tasks: int) -> dict[str, Any]:
    """Return the content of ``meta/info.json``."""
    video = any(about["dtype"] == "video" for about in described.values())
    return {
        "codebase_version": VERSION,
        "robot_type": ROBOT,
        "total_episodes": episodes,
        "total_frames": frames,
        "total_tasks": tasks,
        "chunks_size": FILES_PER_CHUNK,
        "data_files_size_in_mb": DATA_MB,
        "video_files_size_in_mb": VIDEO_MB,
        "fps": RATE,
        "splits": {"train": f"0:{episodes}"},
        "data_path": DATA_PATH,
        "video_path": VIDEO_PATH if video else None,
        "features": dict(described),
    }


def modality(columns: ExportColumns, size: Size | None) -> dict[str, Any]:
    """Return the content of ``meta/modality.json``, by which GR00T divides state and action."""
    parts = {"state": columns.state, "action": columns.action}
    return {
        name: {key: {"start": first, "end": end} for key, (first, end) in spans(ranges).items()}
        for name, ranges in parts.items()
    } | {
        "video": {
            camera: {"original_key": key}
            for camera, key in PICTURE_KEYS.items()
            if size is not None
        },
        "annotation": {"human.task_description": {"original_key": "task_index"}},
    }


def write_json(path: Path, content: object) -> None:
    """Write an indented JSON file, and make its directory."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=4, ensure_ascii=False) + "\n", encoding="utf-8")


def write_tasks(path: Path, goals: Sequence[str]) -> None:
    """Write the table of the tasks, whose pandas index is the goal."""
    kinds = {"task_index": ("int64", "int64"), "task": ("unicode", "object")}
    columns = [
        {"name": n, "field_name": n, "pandas_type": kind, "numpy_type": stored, "metadata": None}
        for n, (kind, stored) in kinds.items()
    ]
    pandas = {
        "index_columns": ["task"],
        "column_indexes": [],
        "columns": columns,
        "pandas_version": "2.0.0",
    }
    table = pa.table({"task_index": pa.array(range(len(goals)), pa.int64()), "task": goals})
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table.replace_schema_metadata({"pandas": json.dumps(pandas)}), path)


def write_episodes(root: Path, rows: Iterable[Mapping[str, Any]]) -> None:
    """Write the table of the episodes to one file."""
    path = root / EPISODES_PATH.format(chunk_index=0, file_index=0)
    path.parent.mkdir(parents=True, exist_ok=True)
    where = {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
    pq.write_table(pa.Table.from_pylist([dict(row) | where for row in rows]), path)
