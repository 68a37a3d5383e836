"""Load an export with robomimic's own classes, compare every number and pixel, and train a little.

python -m verification.loaders.robomimic_check EXPORT.hdf5 DATASET [DATASET ...]
"""

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from verification.loaders.collected import (
    EYES,
    CollectedEpisode,
    MismatchError,
    check_equal,
    collected_episodes,
    held_gaits,
)
from verification.loaders.robomimic_scripts import run_scripts
from verification.loaders.torchvision_shim import declare_torchvision_operators

SEQUENCE = 10
STEPS = 40
_LIMBS = ("left_foot", "right_foot", "left_hand", "right_hand")


def expected_observations(episode: CollectedEpisode) -> dict[str, Any]:
    """Return the observations (frames, columns) by key that robomimic should load, no pictures."""
    poses, names = episode.array("observation/poses"), episode.names("observation/poses")
    found: dict[str, Any] = {}
    for limb in _LIMBS:
        key = f"robot0_{limb.replace('hand', 'eef')}"
        at = [names.index(f"{limb}.{part}") for part in ("x", "y", "z")]
        turn = [names.index(f"{limb}.{part}") for part in ("qw", "qx", "qy", "qz")]
        found |= {f"{key}_pos": poses[:, at], f"{key}_quat_wxyz": poses[:, turn]}
    joints = episode.array("observation/joint_sin_cos")
    found["robot0_joint_pos_sin"], found["robot0_joint_pos_cos"] = joints[:, :27], joints[:, 27:]
    found["robot0_joint_vel"] = episode.array("observation/joint_velocity")
    closure = episode.array("observation/gripper_closure")
    for index, side in enumerate(episode.names("observation/gripper_closure")):
        found[f"robot0_{side}_gripper_qpos"] = closure[:, index : index + 1]
    found["robot0_control_state"] = episode.array("observation/control_state")
    return found


def expected_actions(episode: CollectedEpisode, names: Sequence[str] = ()) -> Any:
    """Return the actions (frames, columns) that robomimic should load.

    Args:
        episode: the collected episode.
        names: of the columns in the export; columns ``gait.*`` stand for the gait that is held.
    """
    gait = episode.array("action/locomotion")
    columns = [name for name in names if name.startswith("gait.")]
    if columns:
        held = held_gaits(gait[:, 0], episode.array("observation/control_state")[:, 0])
        gait = np.stack([held == number for number in range(len(columns))], axis=1)
    hands, grasp, neck = (episode.array(f"action/{part}") for part in ("hands", "grasp", "neck"))
    return np.concatenate([hands, grasp, gait.astype(np.float32), neck], axis=1)


def picture_keys(export: Path) -> dict[str, str]:
    """Return the key of each eye's pictures; empty if there are none."""
    with h5py.File(export, "r") as file:
        keys = {eye: f"robot0_{eye}_camera_image" for eye in EYES}
        return {eye: key for eye, key in keys.items() if key in file["data/demo_0/obs"]}


def loader(
    export: Path, low: Sequence[str], rgb: Sequence[str], *, later: bool = False, **options: Any
) -> Any:
    """Open the export as a robomimic data set; ``later``: with the observations after actions."""
    from robomimic.utils import obs_utils
    from robomimic.utils.dataset import SequenceDataset

    specs = {"obs": {"low_dim": list(low), "rgb": list(rgb)}}
    obs_utils.initialize_obs_utils_with_obs_specs(specs)
    return SequenceDataset(
        hdf5_path=str(export),
        obs_keys=[*low, *rgb],
        dataset_keys=["actions", "rewards", "dones"],
        load_next_obs=later,
        **options,
    )


def check(export: Path, roots: Sequence[Path], *, train: bool = True) -> dict[str, Any]:
    """Load everything, compare it and return a report.

    Raises:
        MismatchError: the loader returned something else than was collected.
    """
    declare_torchvision_operators()
    rgb = picture_keys(export)
    with h5py.File(export, "r") as file:
        low = sorted(set(file["data/demo_0/obs"]) - set(rgb.values()))
        later = "next_obs" in file["data/demo_0"]
    data = loader(export, low, list(rgb.values()), later=later, seq_length=1)
    report = {"frames": len(data), **_compare(export, data, roots, rgb)}
    if later:
        report |= _compare_later(data, roots, low)
    report |= _split(export, low)
    if train:
        report |= run_scripts(export, later=later, scaled=_about_actions(export)[0] is not None)
        report["loss, low-dimensional BC-RNN"] = _train(export, low, [])
        if rgb:
            report["loss, BC-RNN with pictures"] = _train(export, low, list(rgb.values()), 2, 2)
    return report


def _compare(export: Path, data: Any, roots: Sequence[Path], rgb: dict[str, str]) -> dict[str, Any]:
    scale, offset, names = _about_actions(export)
    numbers, pictures, place = 0, 0, 0
    for episode in collected_episodes(roots):
        seen, actions = expected_observations(episode), expected_actions(episode, names)
        if scale is not None:
            # Scaled in single precision, as the exporter does.
            actions = ((actions - offset) / scale).clip(-1.0, 1.0)
        for frame in range(episode.frames):
            item = data[place]
            for key in item["obs"].keys() - rgb.values():
                got, expected = item["obs"][key][0], seen[key][frame]
                numbers += check_equal(f"{key}, frame {place}", got, expected)
            numbers += check_equal(f"actions, frame {place}", item["actions"][0], actions[frame])
            last = frame == episode.frames - 1
            for key in ("rewards", "dones"):
                numbers += check_equal(f"{key}, frame {place}", item[key], [float(last)])
            for eye, key in rgb.items():
                got = item["obs"][key][0]
                expected = episode.picture(eye, frame, got.shape[1::-1])
                pictures += check_equal(f"{key}, frame {place}", got, expected) > 0
            place += 1
    if place != len(data):
        raise MismatchError(f"expected {place} frames, got {len(data)}")
    return {"numbers equal": numbers, "pictures equal": pictures}


def _compare_later(data: Any, roots: Sequence[Path], low: Sequence[str]) -> dict[str, Any]:
    """Compare the observations after each action; after the last one of a file it stays."""
    numbers, place = 0, 0
    for episode in collected_episodes(roots):
        whole = expected_observations(replace(episode, frames=episode.meta["frames"]))
        for frame in range(episode.frames):
            after = min(frame + 1, episode.meta["frames"] - 1)
            item = data[place]["next_obs"]
            for key in low:
                what = f"next {key}, frame {place}"
                numbers += check_equal(what, item[key][0], whole[key][after])
            place += 1
    return {"numbers of next observations equal": numbers}


def _about_actions(export: Path) -> tuple[Any, Any, list[str]]:
    """Return scale and offset of the actions, if they are scaled, and their names."""
    with h5py.File(export, "r") as file:
        about = file["data"].attrs
        names = [str(name) for name in about["action_names"]]
        return about.get("action_scale"), about.get("action_offset"), names


def _split(export: Path, low: Sequence[str]) -> dict[str, Any]:
    """Check both parts of the split, opened as robomimic's training script does."""
    demos = {}
    for name in ("train", "valid"):
        part = loader(export, low, [], seq_length=SEQUENCE, filter_by_attribute=name)
        demos[name] = set(part.demos)
    with h5py.File(export, "r") as file:
        if demos["train"] & demos["valid"] or set.union(*demos.values()) != set(file["data"]):
            raise MismatchError(f"the split is wrong: {demos}")
    return {f"demos, {name}": len(part) for name, part in demos.items()}


def _train(
    export: Path, low: Sequence[str], rgb: Sequence[str], steps: int = STEPS, batch: int = 16
) -> list[float]:
    """Train a BC-RNN of robomimic for a few steps; return the first and the last loss.

    Raises:
        MismatchError: the loss is not finite, or does not fall in :data:`STEPS` steps.
    """
    import torch
    from robomimic.algo import algo_factory
    from robomimic.config import config_factory
    from robomimic.utils import obs_utils, torch_utils

    torch.manual_seed(0)
    data = loader(export, low, rgb, seq_length=SEQUENCE)
    config = config_factory("bc")
    with config.values_unlocked():
        config.observation.modalities.obs.low_dim = list(low)
        config.observation.modalities.obs.rgb = list(rgb)
        config.algo.rnn.enabled, config.algo.rnn.horizon = True, SEQUENCE
        config.train.seq_length, config.train.batch_size = SEQUENCE, batch
        if rgb:
            config.observation.encoder.rgb.core_kwargs.backbone_kwargs.pretrained = False
    obs_utils.initialize_obs_utils_with_config(config)
    shapes = {key: list(np.asarray(data[0]["obs"][key]).shape[1:]) for key in [*low, *rgb]}
    shapes |= {key: [shapes[key][2], *shapes[key][:2]] for key in rgb}
    model = algo_factory(
        algo_name="bc",
        config=config,
        obs_key_shapes=shapes,
        ac_dim=data[0]["actions"].shape[-1],
        device=torch_utils.get_torch_device(try_to_use_cuda=False),
    )
    model.set_train()
    batches = torch.utils.data.DataLoader(data, batch_size=batch, shuffle=True)
    losses: list[float] = []
    while len(losses) < steps:
        for items in batches:
            prepared = model.process_batch_for_training(items)
            prepared = model.postprocess_batch_for_training(prepared, obs_normalization_stats=None)
            done = model.train_on_batch(prepared, epoch=0, validate=False)
            losses.append(float(done["losses"]["action_loss"]))
            if len(losses) == steps:
                break
    falls = float(np.mean(losses[-5:])) < 0.95 * float(np.mean(losses[:5]))
    # Two steps with pictures only show that the network takes them.
    if not np.isfinite(losses).all() or (steps >= STEPS and not falls):
        raise MismatchError(f"training does not work: losses {losses}")
    return [round(losses[0], 4), round(losses[-1], 4)]


if __name__ == "__main__":
    for name, found in check(Path(sys.argv[1]), [Path(text) for text in sys.argv[2:]]).items():
        print(f"= {name:<32} {found}")
