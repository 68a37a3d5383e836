"""Writes episodes as one HDF5 file in robomimic's layout.

::

    data                                    attributes total, env_args, names of the actions ...
    data/demo_0                             attributes num_samples, seed, task, success ...
    data/demo_0/obs/robot0_left_eef_pos     float32, as other low-dimensional keys; attribute names
    data/demo_0/obs/robot0_left_camera_image    uint8 (frames, height, width, 3) RGB
    data/demo_0/actions                     float32
    data/demo_0/rewards, dones
    mask/train, mask/valid                  names of demos
"""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from common.episodes.columns import CAMERAS
from common.episodes.episode_file import RATE, Episode
from lab.demonstrations.export.fields import (
    ACTION,
    ROBOT,
    Float32,
    column_names,
    low_dimensional,
    read_columns,
)
from lab.demonstrations.export.selection import ExportInput, SelectedEpisode, open_selected
from lab.demonstrations.export.staging import staged
from lab.errors import DatasetError

VALID = 0.1
"""Share of the demos that is kept for validation."""
_SPLIT_SEED = 0
_SPARE = 1.05
"""The file is a little larger than its pictures."""
_GZIP_LEVEL = 1
NO_ENVIRONMENT = 0
"""Type in ``env_args`` for which robomimic has no environment, so that it does not look for one."""

Scaling = tuple[Float32, Float32]
"""Scale and offset of each column: ``action = scaled * scale + offset``."""


def image_key(camera: str) -> str:
    """Return the name of a camera's pictures among the observations."""
    return f"robot0_{camera}_camera_image"


def is_robomimic(path: Path) -> bool:
    """Whether a file is an export of this module, not any demonstrations in this format."""
    if not path.is_file() or not h5py.is_hdf5(path):
        return False
    try:
        with h5py.File(path, "r") as file:
            return "data" in file and file["data"].attrs.get("robot") == ROBOT
    except OSError:  # a file that was cut short
        return False


def write(
    source: ExportInput,
    out: Path,
    *,
    force: bool = False,
    scale_actions: bool = False,
    compress: bool = False,
    on_episode: Callable[[], None] = lambda: None,
) -> None:
    """Write the file, whole or not at all.

    Args:
        source: the episodes.
        out: the file.
        force: whether to replace an earlier export.
        scale_actions: whether to map each column of the actions to -1 ... 1 by its range in these
            episodes.
        compress: whether to compress pictures by gzip; smaller, slower to train from.
        on_episode: called after each episode.

    Raises:
        DatasetError: it cannot be written.
        EpisodeError: an episode cannot be read.
    """
    with staged(out, force=force, ours=is_robomimic) as path:
        if not compress:
            _check_room(source, path.parent, out)
        ranges = action_ranges(source)
        scaling = _scaling(*ranges) if scale_actions else None
        # The newer layout of the file lets robomimic open it as it does by default (SWMR).
        with h5py.File(path, "w", libver="latest") as file:
            data = file.create_group("data")
            for index, selected in enumerate(source.episodes):
                with open_selected(selected) as episode:
                    demo = data.create_group(f"demo_{index}")
                    _write_demo(demo, selected, episode, scaling)
                    _write_pictures(demo["obs"], source, selected, episode, compress)
                on_episode()
            _describe(data, source, ranges, scaling)
            _write_masks(file.create_group("mask"), len(source.episodes))


def _check_room(source: ExportInput, folder: Path, out: Path) -> None:
    if source.size is None:
        return
    width, height = source.size
    needed = int(source.frames * len(CAMERAS) * width * height * 3 * _SPARE)
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise DatasetError(
            f"{out} would take {needed * 1e-9:.1f} GB, since robomimic's pictures are raw, but "
            f"{free * 1e-9:.1f} GB are free; give smaller --width and --height, or --compress"
        )


def action_ranges(source: ExportInput) -> tuple[Float32, Float32]:
    """Return the smallest and the largest value of each column of the actions."""
    low = np.full(len(column_names(ACTION)), np.inf, dtype=np.float32)
    high = -low
    for selected in source.episodes:
        with open_selected(selected) as episode:
            actions = read_columns(ACTION, episode, slice(0, selected.frames))
        low, high = np.minimum(low, actions.min(axis=0)), np.maximum(high, actions.max(axis=0))
    return low, high


def _scaling(low: Float32, high: Float32) -> Scaling:
    """Return the scaling of a range to -1 ... 1; a constant column becomes 0."""
    scale = (high - low) / 2
    return np.where(scale > 0, scale, 1).astype(np.float32), ((high + low) / 2).astype(np.float32)


def _write_demo(
    demo: Any, selected: SelectedEpisode, episode: Episode, scaling: Scaling | None
) -> None:
    """Write everything of an episode but its pictures."""
    meta, frames = selected.meta, slice(0, selected.frames)
    demo.attrs["num_samples"] = selected.frames
    for name in ("task", "seed", "verdict", "reason", "success", "operator", "source"):
        demo.attrs[name] = getattr(meta, name)
    demo.attrs["versions"] = json.dumps(meta.versions)
    demo.attrs["origin"] = json.dumps(meta.origin)
    observed = demo.create_group("obs")
    for key, columns in low_dimensional().items():
        array = observed.create_dataset(key, data=columns.read(episode, frames))
        array.attrs["names"], array.attrs["doc"] = list(columns.names), columns.doc
    actions = read_columns(ACTION, episode, frames)
    if scaling is not None:
        actions = ((actions - scaling[1]) / scaling[0]).clip(-1.0, 1.0)
    dones = np.zeros(selected.frames, dtype=np.float32)
    dones[-1] = 1.0
    demo.create_dataset("actions", data=actions)
    demo.create_dataset("rewards", data=selected.rewards())
    demo.create_dataset("dones", data=dones)


def _write_pictures(
    observed: Any, source: ExportInput, selected: SelectedEpisode, episode: Episode, compress: bool
) -> None:
    if source.size is None:
        return
    width, height = source.size
    options = {"compression": "gzip", "compression_opts": _GZIP_LEVEL} if compress else {}
    for camera in CAMERAS:
        array = observed.create_dataset(
            image_key(camera),
            shape=(selected.frames, height, width, 3),
            dtype=np.uint8,
            chunks=(1, height, width, 3) if compress else None,
            **options,
        )
        for frame in range(selected.frames):
            array[frame] = source.picture(episode, camera, frame)


def _describe(
    data: Any,
    source: ExportInput,
    ranges: tuple[Float32, Float32],
    scaling: Scaling | None,
) -> None:
    data.attrs["total"] = source.frames
    data.attrs["env_args"] = json.dumps(
        {
            "env_name": ", ".join(source.tasks),
            "type": NO_ENVIRONMENT,
            "env_version": source.episodes[0].meta.source,
            "env_kwargs": {},
        }
    )
    data.attrs["robot"], data.attrs["rate"] = ROBOT, RATE
    data.attrs["operators"] = json.dumps(source.operators)
    data.attrs["goals"] = json.dumps(source.goals)
    data.attrs["action_names"] = column_names(ACTION)
    data.attrs["action_doc"] = json.dumps(
        [[columns.doc, list(columns.names)] for columns in ACTION]
    )
    data.attrs["action_min"], data.attrs["action_max"] = ranges
    if scaling is not None:
        data.attrs["action_scale"], data.attrs["action_offset"] = scaling
        data.attrs["action_scaling"] = "recorded action = action * action_scale + action_offset"


def _write_masks(mask: Any, demos: int) -> None:
    order = np.random.default_rng(_SPLIT_SEED).permutation(demos)
    # One demo is for training; of two or more at least one is for validation.
    held = 0 if demos < 2 else max(1, round(VALID * demos))
    for name, indices in (("valid", order[:held]), ("train", order[held:])):
        names = [f"demo_{index}" for index in sorted(indices.tolist())]
        mask.create_dataset(name, data=np.array(names, dtype="S16"))
