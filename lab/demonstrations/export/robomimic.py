"""Writes episodes as one HDF5 file in robomimic's layout.

::

    data                                    attributes total, env_args, names of the actions ...
    data/demo_0                             attributes num_samples, seed, task, success ...
    data/demo_0/obs/robot0_left_eef_pos     float32, as other low-dimensional keys; attribute names
    data/demo_0/obs/robot0_left_camera_image    uint8 (frames, height, width, 3) RGB
    data/demo_0/actions                     float32
    data/demo_0/next_obs                    as obs, a frame later; only if asked for
    data/demo_0/rewards, dones
    mask/train, mask/valid                  names of demos

Beside it stands a configuration for robomimic's training script.
"""

import json
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from common.episodes.columns import AXES, CAMERAS, RATE
from common.episodes.episode_file import Episode
from common.episodes.errors import EpisodeDamagedError, reading
from lab.demonstrations.export import robomimic_config
from lab.demonstrations.export.fields import ROBOT, column_names, read_columns
from lab.demonstrations.export.gaits import Float32
from lab.demonstrations.export.selection import ExportInput, SelectedEpisode, open_selected
from lab.demonstrations.export.staging import staged
from lab.errors import DatasetError

VALID = 0.1
"""Share of the demos that is kept for validation."""
_SPLIT_SEED = 0
_SPARE = 1.05
"""The file is a little larger than its pictures."""
_GZIP_LEVEL = 1
TRAIN = "python -m robomimic.scripts.train --config"
NO_ENVIRONMENT = 0
"""Type in ``env_args`` for which robomimic has no environment, so that it does not look for one."""

Scaling = tuple[Float32, Float32]
"""Scale and offset of each column: ``action = scaled * scale + offset``."""


def image_key(camera: str) -> str:
    """Return the name of a camera's pictures among the observations."""
    return f"robot0_{camera}_camera_image"


def is_robomimic(path: Path) -> bool:
    """Whether a file is an export of this module, not any demonstrations in this format.

    Raises:
        EpisodeAccessError: it cannot be opened now.
    """
    if not path.is_file():
        return False
    try:
        with reading(path), h5py.File(path, "r") as file:
            return "data" in file and file["data"].attrs.get("robot") == ROBOT
    except EpisodeDamagedError:  # cut short, or no HDF5 file
        return False


def write(
    source: ExportInput,
    out: Path,
    *,
    force: bool = False,
    scale_actions: bool = True,
    compress: bool = False,
    next_obs: bool = False,
    on_episode: Callable[[], None] = lambda: None,
) -> list[str]:
    """Write the file, whole or not at all; return what the user should know of it.

    Args:
        source: the episodes.
        out: the file.
        force: whether to replace an earlier export.
        scale_actions: whether to map each column of the actions to -1 ... 1 by its range in these
            episodes; robomimic's policies act, and its scripts check, within these limits.
        compress: whether to compress pictures by gzip; smaller, slower to train from.
        next_obs: whether to write the observations after each action, too, which algorithms that
            learn a value need; doubles the size.
        on_episode: called after each episode.

    Raises:
        DatasetError: it cannot be written.
        EpisodeError: an episode cannot be read.
    """
    robomimic_config.check_free(out)
    with staged(out, force=force, ours=is_robomimic) as path:
        if not compress:
            _check_room(source, path.parent, out, 2 if next_obs else 1)
        ranges = action_ranges(source)
        scaling = _scaling(*ranges) if scale_actions else None
        # The newer layout of the file lets robomimic open it as it does by default (SWMR).
        with h5py.File(path, "w", libver="latest") as file:
            data = file.create_group("data")
            for index, selected in enumerate(source.episodes):
                with open_selected(selected) as episode:
                    demo = data.create_group(f"demo_{index}")
                    _write_demo(demo, source, selected, episode, scaling)
                    for later, group in enumerate(("obs", "next_obs")[: 1 + next_obs]):
                        observed = demo.create_group(group)
                        _write_observations(observed, source, selected, episode, later)
                        _write_pictures(observed, source, selected, episode, later, compress)
                on_episode()
            _describe(data, source, ranges, scaling)
            frames = _write_masks(file.create_group("mask"), source)
    robomimic_config.write_config(
        out,
        low_dim=list(source.columns.low_dimensional()),
        rgb=[image_key(camera) for camera in CAMERAS if source.size is not None],
        frames=frames,
        next_obs=next_obs,
    )
    return _notes(ranges, scaled=scale_actions)


def how_to_use(out: Path) -> str:
    """Return a line that says how to train on the export."""
    config = shlex.quote(str(robomimic_config.config_path(out)))
    return f"to train on it: {TRAIN} {config}"


def _notes(ranges: tuple[Float32, Float32], *, scaled: bool) -> list[str]:
    if scaled:
        return ["actions are scaled to -1 ... 1; attributes action_scale, action_offset undo it"]
    worst = float(np.max(np.abs(ranges)))
    if worst <= 1.0:
        return []
    return [
        f"actions reach {worst:.1f}, but robomimic's policies act within -1 ... 1 and its "
        "get_dataset_info refuses others; leave --no-scale-actions out"
    ]


def _check_room(source: ExportInput, folder: Path, out: Path, times: int) -> None:
    if source.size is None:
        return
    width, height = source.size
    needed = int(times * source.frames * len(CAMERAS) * width * height * 3 * _SPARE)
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise DatasetError(
            f"{out} would take {needed * 1e-9:.1f} GB, since robomimic's pictures are raw, but "
            f"{free * 1e-9:.1f} GB are free; give smaller --width and --height, or --compress"
        )


def action_ranges(source: ExportInput) -> tuple[Float32, Float32]:
    """Return the smallest and the largest value of each column of the actions."""
    columns = source.columns.action
    low = np.full(len(column_names(columns)), np.inf, dtype=np.float32)
    high = -low
    for selected in source.episodes:
        with open_selected(selected) as episode:
            actions = read_columns(columns, episode, slice(0, selected.frames))
        low, high = np.minimum(low, actions.min(axis=0)), np.maximum(high, actions.max(axis=0))
    return low, high


def _scaling(low: Float32, high: Float32) -> Scaling:
    """Return the scaling of a range to -1 ... 1; a constant column becomes 0."""
    scale = (high - low) / 2
    return np.where(scale > 0, scale, 1).astype(np.float32), ((high + low) / 2).astype(np.float32)


def _write_demo(
    demo: Any,
    source: ExportInput,
    selected: SelectedEpisode,
    episode: Episode,
    scaling: Scaling | None,
) -> None:
    """Write everything of an episode but its observations."""
    meta, frames = selected.meta, slice(0, selected.frames)
    demo.attrs["num_samples"] = selected.frames
    for name in ("task", "seed", "verdict", "reason", "success", "operator", "source", "machine"):
        demo.attrs[name] = getattr(meta, name)
    demo.attrs["versions"] = json.dumps(meta.versions)
    demo.attrs["origin"] = json.dumps(meta.origin)
    actions = read_columns(source.columns.action, episode, frames)
    if scaling is not None:
        actions = ((actions - scaling[1]) / scaling[0]).clip(-1.0, 1.0)
    dones = np.zeros(selected.frames, dtype=np.float32)
    dones[-1] = 1.0
    demo.create_dataset("actions", data=actions)
    demo.create_dataset("rewards", data=selected.rewards())
    demo.create_dataset("dones", data=dones)


def _observed(selected: SelectedEpisode, later: int) -> list[int]:
    """Return the frame of each observation that is ``later`` frames after; the last stays."""
    last = selected.meta.frames - 1
    return [min(frame + later, last) for frame in range(selected.frames)]


def _write_observations(
    observed: Any, source: ExportInput, selected: SelectedEpisode, episode: Episode, later: int
) -> None:
    """Write all observations but the pictures."""
    frames = _observed(selected, later)
    for key, columns in source.columns.low_dimensional().items():
        values = columns.read(episode, slice(0, frames[-1] + 1))[frames]
        array = observed.create_dataset(key, data=values)
        array.attrs["names"], array.attrs["doc"] = list(columns.names), columns.doc


def _write_pictures(
    observed: Any,
    source: ExportInput,
    selected: SelectedEpisode,
    episode: Episode,
    later: int,
    compress: bool,
) -> None:
    if source.size is None or selected.meta.picture_size is None:
        return
    width, height = source.size
    options = {"compression": "gzip", "compression_opts": _GZIP_LEVEL} if compress else {}
    for camera, about in source.cameras(selected.meta.picture_size).items():
        array = observed.create_dataset(
            image_key(camera),
            shape=(selected.frames, height, width, 3),
            dtype=np.uint8,
            chunks=(1, height, width, 3) if compress else None,
            **options,
        )
        array.attrs.update(about)
        for index, frame in enumerate(_observed(selected, later)):
            array[index] = source.picture(episode, camera, frame)


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
    data.attrs["frame"] = AXES
    actions = source.columns.action
    data.attrs["action_names"] = column_names(actions)
    data.attrs["action_doc"] = json.dumps(
        [[columns.doc, list(columns.names)] for columns in actions]
    )
    data.attrs["action_min"], data.attrs["action_max"] = ranges
    if scaling is not None:
        data.attrs["action_scale"], data.attrs["action_offset"] = scaling
        data.attrs["action_scaling"] = "recorded action = action * action_scale + action_offset"


def _write_masks(mask: Any, source: ExportInput) -> dict[str, int]:
    """Write the masks and return the number of frames of each."""
    demos = len(source.episodes)
    order = np.random.default_rng(_SPLIT_SEED).permutation(demos)
    # One demo is for training; of two or more at least one is for validation.
    held = 0 if demos < 2 else max(1, round(VALID * demos))
    frames = {}
    for name, indices in (("valid", order[:held]), ("train", order[held:])):
        names = [f"demo_{index}" for index in sorted(indices.tolist())]
        mask.create_dataset(name, data=np.array(names, dtype="S16"))
        frames[name] = sum(source.episodes[index].frames for index in indices.tolist())
    return frames
