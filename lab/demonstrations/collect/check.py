"""Checks a data set: every file, array, time stamp and picture."""

import json
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from common.episodes.columns import CAMERAS, COLUMNS, Column
from common.episodes.episode_file import PERIOD_NS, Episode, open_episode
from common.episodes.errors import EpisodeError
from common.episodes.folder import IndexLine
from common.errors import TrillError
from lab.demonstrations.collect.config import EpisodeConfig, origin_of
from lab.demonstrations.collect.episode import make_episode
from lab.demonstrations.collect.store import DatasetStore
from lab.demonstrations.recorded.config import RecordedConfig
from lab.trials.provenance import CodeVersion

_NORM_TOLERANCE = 1e-6
"""Tolerance of a quaternion's norm."""


def check(store: DatasetStore, on_file: Callable[[], None] = lambda: None) -> list[str]:
    """Return all problems of a data set, each as ``file: problem``.

    Args:
        store: the data set.
        on_file: called after each file.

    Raises:
        EpisodeError: there is no data set.
    """
    config = store.config()
    found: list[str] = []
    lines: dict[str, IndexLine] = {}
    for path in store.files():
        name = str(path.relative_to(store.root))
        try:
            line = store.read(path)
            lines[name] = line
            problems = [*_check_verdict(line, config), *(_check_episode(path) if line.kept else ())]
            if origin_of(line.meta) != config.origin():
                problems.append("made with other settings than those in dataset.json")
        except TrillError as error:
            problems = [str(error)]
        found += [f"{name}: {problem}" for problem in problems]
        on_file()
    seeds = Counter(line.meta.seed for line in lines.values())
    found += [f"seed {seed} is there twice" for seed in sorted(seeds) if seeds[seed] > 1]
    return found + list(_check_index(store, lines))


def _check_verdict(line: IndexLine, config: EpisodeConfig | RecordedConfig) -> Iterator[str]:
    meta = line.meta
    if not line.kept and meta.success:
        yield "a success that was not kept"
    if line.kept and not meta.success and not config.keep_failures:
        yield f"kept, but its verdict is {meta.verdict}"
    if line.kept and not meta.source:
        yield "does not say which code made it"


def _check_index(store: DatasetStore, lines: dict[str, IndexLine]) -> Iterator[str]:
    """Compare the index with the files."""
    hint = f"mend with: trill collect --reindex {store.root}"
    try:
        index = {line.file: line for line in store.index()}
    except EpisodeError as error:
        yield str(error)
        return
    there = {str(path.relative_to(store.root)) for path in store.files()}
    yield from (f"{name}: in the index, but not there" for name in sorted(index.keys() - there))
    yield from (f"{name}: not in the index; {hint}" for name in sorted(there - index.keys()))
    for name in sorted(index.keys() & lines.keys()):
        if index[name].sha256 != lines[name].sha256:
            yield f"{name}: its SHA-256 is not that of the index: the file was changed"
        elif index[name] != lines[name]:
            yield f"{name}: the index has other metadata; {hint}"


def _check_episode(path: Path) -> Iterator[str]:
    with open_episode(path) as episode:
        arrays = {}
        for column in COLUMNS:
            if column.optional and not episode.holds(column.path):
                continue
            problem, values = _read_array(episode, column)
            if problem:
                yield problem
            else:
                arrays[column.path] = values
        meta = episode.meta
        yield from _check_quaternions(arrays)
        yield from _check_times(arrays, round(meta.frame_tolerance * 1e9))
        if meta.success and not 0 <= meta.verdict_frame <= meta.frames:
            yield f"a success whose verdict came in frame {meta.verdict_frame} of {meta.frames}"
        if episode.has_pictures != (meta.picture_size is not None):
            yield f"has {'' if episode.has_pictures else 'no '}pictures, against its metadata"
        elif episode.has_pictures:
            yield from _check_pictures(episode)


def _read_array(episode: Episode, column: Column) -> tuple[str, Any]:
    try:
        values = episode.array(column.path)
    except EpisodeError as error:
        return f"{column.path} cannot be read: {error}", None
    frames = episode.meta.frames
    right = values.shape[0] == frames and (column.varies or values.shape[1:] == column.shape)
    if not right or values.dtype != np.dtype(column.dtype):
        width = ("any",) if column.varies else column.shape
        return (
            f"{column.path}: expected {column.dtype} {(frames, *width)}, got {values.dtype.str} "
            f"{values.shape}"
        ), None
    wrong = np.argwhere(~np.isfinite(values))
    if len(wrong):
        return f"{column.path}: not a finite number in frame {wrong[0][0]}", None
    return "", values


def _check_quaternions(arrays: dict[str, Any]) -> Iterator[str]:
    for path, offset in (
        ("observation/poses", 3),
        ("action/hands", 3),
        ("truth/base_quaternion", 0),
    ):
        if path not in arrays:
            continue
        values = arrays[path]
        parts = values.reshape(len(values), -1, offset + 4)[:, :, offset:]
        wrong = np.argwhere(np.abs(np.linalg.norm(parts, axis=2) - 1.0) > _NORM_TOLERANCE)
        if len(wrong):
            yield f"{path}: a quaternion that is not of unit length in frame {wrong[0][0]}"


def _check_times(arrays: dict[str, Any], tolerance_ns: int) -> Iterator[str]:
    now = arrays.get("time/robot_ns")
    if now is None:
        return
    uneven = np.flatnonzero(np.abs(np.diff(now) - PERIOD_NS) > tolerance_ns)
    if len(uneven):
        at = int(uneven[0])
        yield (
            f"time/robot_ns: {(now[at + 1] - now[at]) * 1e-6:.3f} ms from frame {at} to {at + 1}, "
            f"expected {PERIOD_NS * 1e-6:g}"
        )
    for name in ("state", "controller", "picture", "truth", "seen"):
        stamps = arrays.get(f"time/{name}_ns")
        if stamps is None:
            continue
        # A link that does not keep the order may show the operator something older again.
        if name != "seen" and (np.diff(stamps) < 0).any():
            yield f"time/{name}_ns goes back in frame {int(np.argmax(np.diff(stamps) < 0)) + 1}"
        if (stamps > now).any():
            yield f"time/{name}_ns is of the future in frame {int(np.argmax(stamps > now))}"


def _check_pictures(episode: Episode) -> Iterator[str]:
    size = episode.meta.picture_size
    for camera in CAMERAS:
        for frame in range(episode.meta.frames):
            try:
                picture = episode.picture(camera, frame)
            except EpisodeError as error:
                yield f"{camera} camera, frame {frame}: no picture ({error})"
                break
            if picture.shape[1::-1] != size or picture.shape[2] != 3:
                yield f"{camera} camera, frame {frame}: a picture of {picture.shape[1::-1]}"
                break


def remake(store: DatasetStore, seed: int) -> str:
    """Make the trial with ``seed`` again from its own settings and compare the bytes.

    Returns:
        the differences; empty: there are none.

    Raises:
        EpisodeError: there is no such trial.
    """
    paths = [path for path in store.files() if path.stem == f"{seed:06d}"]
    if not paths:
        raise EpisodeError(f"no trial with seed {seed} in {store.root}")
    before = store.read(paths[0])
    if before.meta.recording:
        raise EpisodeError(f"{paths[0]} is of a recorded run, which cannot be made again")
    made = make_episode(EpisodeConfig.of(before.meta), seed)
    meta = made.meta
    content = made.content or (meta.model_dump_json() + "\n").encode()
    if content == paths[0].read_bytes():
        return ""
    name = paths[0].relative_to(store.root)
    code = [CodeVersion(source=m.source, versions=m.versions) for m in (before.meta, meta)]
    changes = code[0].differences(code[1])
    if changes:
        return f"{name}: other bytes, by other code. There | here: {'; '.join(changes)}"
    if before.meta.machine != meta.machine:
        return (
            f"{name}: other bytes on another kind of processor, where the last digits differ; make "
            f"it again on one like there. There | here: {before.meta.machine or 'unknown'} | "
            f"{meta.machine}"
        )
    first, second = (json.loads(m.model_dump_json()) for m in (before.meta, meta))
    fields = [f"{k}: {first[k]} | {second[k]}" for k in first if first[k] != second[k]]
    return f"{name}: other bytes by the same code. There | here: {'; '.join(fields) or 'frames'}"
