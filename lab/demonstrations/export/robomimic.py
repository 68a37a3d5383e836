"""Writes episodes as one HDF5 file in robomimic's layout.

::

    data                                    attributes total, env_args, names of the actions ...
    data/demo_0                             attributes num_samples, seed, task, success ...
    data/demo_0/obs/robot0_left_eef_pos     float32, as other low-dimensional keys; attribute names
    data/demo_0/obs/robot0_left_eye_image   uint8 (frames, height, width, 3) RGB
    data/demo_0/actions                     float32
    data/demo_0/rewards, dones
    mask/train, mask/valid                  names of demos
"""

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from common.episodes.columns import CAMERAS
from common.episodes.episode_file import RATE, Episode
from lab.demonstrations.export.fields import ACTION, Float32, join, low_dimensional, names_of
from lab.demonstrations.export.source import SelectedEpisode, Source, reading
from lab.demonstrations.export.staging import staged
from lab.errors import DatasetError

ROBOT = "draco3"
VALID = 0.1
"""Part of the demos that is kept for validation."""
_SPLIT_SEED = 0
_SPARE = 1.05
"""The file is a little larger than its pictures."""
_GZIP = 1
NO_ENVIRONMENT = 0
"""``env_args``: a type that robomimic has no environment for, so that it does not look for one."""

Tick = Callable[[int], None]


def image_key(camera: str) -> str:
    """Name of a camera's pictures among the observations."""
    return f"robot0_{camera}_eye_image"


def is_robomimic(path: Path) -> bool:
    """Whether a file is an export of ours, not somebody's own demonstrations in this format."""
    if not path.is_file() or not h5py.is_hdf5(path):
        return False
    try:
        with h5py.File(path, "r") as file:
            return "data" in file and file["data"].attrs.get("robot") == ROBOT
    except OSError:  # cut short: whose it was cannot be told
        return False


def write(
    source: Source,
    out: Path,
    *,
    force: bool = False,
    scale_actions: bool = False,
    compress: bool = False,
    tick: Tick = lambda _frames: None,
) -> None:
    """Write the file, whole or not at all.

    Args:
        source: what to write.
        out: the file.
        force: replace an earlier export.
        scale_actions: map each column of the actions to -1 ... 1 by its range in these episodes.
        compress: pictures by gzip; smaller, slower to train from.
        tick: told how many frames are done, as they are.

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
            for index, chosen in enumerate(source.episodes):
                with reading(chosen) as episode:
                    demo = data.create_group(f"demo_{index}")
                    _write_demo(demo, chosen, episode)
                    actions = join(ACTION, episode, slice(0, chosen.frames))
                    if scaling is not None:
                        scale, offset = scaling
                        actions = ((actions - offset) / scale).clip(-1.0, 1.0)
                    demo.create_dataset("actions", data=actions)
                    for count in _write_pictures(demo["obs"], source, chosen, episode, compress):
                        tick(count)
            _describe(data, source, ranges, scaling)
            _write_masks(file.create_group("mask"), len(source.episodes))


def _check_room(source: Source, folder: Path, out: Path) -> None:
    if source.size is None:
        return
    width, height = source.size
    needed = int(source.frames * len(CAMERAS) * width * height * 3 * _SPARE)
    free = shutil.disk_usage(folder).free
    if needed > free:
        raise DatasetError(
            f"{out} would take {needed * 1e-9:.1f} GB, robomimic's pictures being raw, but "
            f"{free * 1e-9:.1f} GB are free; give smaller --width and --height, or --compress"
        )


def action_ranges(source: Source) -> tuple[Float32, Float32]:
    """Smallest and largest value of each column of the actions, over all frames."""
    low = np.full(len(names_of(ACTION)), np.inf, dtype=np.float32)
    high = -low
    for chosen in source.episodes:
        with reading(chosen) as episode:
            actions = join(ACTION, episode, slice(0, chosen.frames))
        low, high = np.minimum(low, actions.min(axis=0)), np.maximum(high, actions.max(axis=0))
    return low, high


def _scaling(low: Float32, high: Float32) -> tuple[Float32, Float32]:
    """Scale and offset with ``action = scaled * scale + offset``; a constant column becomes 0."""
    scale = (high - low) / 2
    return np.where(scale > 0, scale, 1).astype(np.float32), ((high + low) / 2).astype(np.float32)


def _write_demo(demo: Any, chosen: SelectedEpisode, episode: Episode) -> None:
    meta, frames = chosen.meta, slice(0, chosen.frames)
    demo.attrs["num_samples"] = chosen.frames
    demo.attrs["task"], demo.attrs["seed"] = meta.task, meta.seed
    demo.attrs["verdict"], demo.attrs["reason"] = meta.verdict, meta.reason
    demo.attrs["success"], demo.attrs["operator"] = meta.success, meta.operator
    demo.attrs["source"] = meta.source
    demo.attrs["versions"] = json.dumps(meta.versions)
    demo.attrs["origin"] = json.dumps(meta.origin)
    observed = demo.create_group("obs")
    for key, part in low_dimensional().items():
        array = observed.create_dataset(key, data=part.of(episode, frames))
        array.attrs["names"], array.attrs["doc"] = list(part.names), part.doc
    dones = np.zeros(chosen.frames, dtype=np.float32)
    dones[-1] = 1.0
    demo.create_dataset("rewards", data=chosen.rewards())
    demo.create_dataset("dones", data=dones)


def _write_pictures(
    observed: Any, source: Source, chosen: SelectedEpisode, episode: Episode, compress: bool
) -> Iterator[int]:
    """One picture after the other; yields the frames done by each."""
    if source.size is None:
        yield chosen.frames
        return
    width, height = source.size
    arrays = {
        camera: observed.create_dataset(
            image_key(camera),
            shape=(chosen.frames, height, width, 3),
            dtype=np.uint8,
            chunks=(1, height, width, 3) if compress else None,
            compression="gzip" if compress else None,
            compression_opts=_GZIP if compress else None,
        )
        for camera in CAMERAS
    }
    for frame in range(chosen.frames):
        for camera, array in arrays.items():
            array[frame] = source.picture(episode, camera, frame)
        yield 1


def _describe(
    data: Any,
    source: Source,
    ranges: tuple[Float32, Float32],
    scaling: tuple[Float32, Float32] | None,
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
    data.attrs["action_names"] = names_of(ACTION)
    data.attrs["action_doc"] = json.dumps([[part.doc, list(part.names)] for part in ACTION])
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
