"""Loads an export with robomimic's own classes, compares every number and pixel, and trains a bit.

python -m verification.loaders.robomimic_check EXPORT.hdf5 DATASET [DATASET ...]
"""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from verification.loaders.original import EYES, MismatchError, Original, originals, same
from verification.loaders.shim import make_importable

SEQUENCE = 10
STEPS = 40
_LIMBS = ("left_foot", "right_foot", "left_hand", "right_hand")


def expected_observations(original: Original) -> dict[str, Any]:
    """What robomimic should see of an episode but the pictures: (frames, columns) by key."""
    poses, names = original.array("observation/poses"), original.names("observation/poses")
    found: dict[str, Any] = {}
    for limb in _LIMBS:
        key = f"robot0_{limb.replace('hand', 'eef')}"
        at = [names.index(f"{limb}.{part}") for part in ("x", "y", "z")]
        turn = [names.index(f"{limb}.{part}") for part in ("qw", "qx", "qy", "qz")]
        found |= {f"{key}_pos": poses[:, at], f"{key}_quat": poses[:, turn]}
    joints = original.array("observation/joint_sin_cos")
    found["robot0_joint_pos_sin"], found["robot0_joint_pos_cos"] = joints[:, :27], joints[:, 27:]
    found["robot0_joint_vel"] = original.array("observation/joint_velocity")
    closure = original.array("observation/gripper_closure")
    for index, side in enumerate(original.names("observation/gripper_closure")):
        found[f"robot0_{side}_gripper_qpos"] = closure[:, index : index + 1]
    found["robot0_control_state"] = original.array("observation/control_state")
    return found


def expected_actions(original: Original) -> Any:
    """What robomimic should see as actions (frames, columns)."""
    parts = ("hands", "grasp", "locomotion", "neck")
    return np.concatenate([original.array(f"action/{part}") for part in parts], axis=1)


def picture_keys(export: Path) -> dict[str, str]:
    """Key of each eye's pictures; empty: there are none."""
    with h5py.File(export, "r") as file:
        keys = {eye: f"robot0_{eye}_camera_image" for eye in EYES}
        return {eye: key for eye, key in keys.items() if key in file["data/demo_0/obs"]}


def loader(export: Path, low: Sequence[str], rgb: Sequence[str], **options: Any) -> Any:
    """The export as robomimic's data set, the file opened as by default."""
    from robomimic.utils import obs_utils
    from robomimic.utils.dataset import SequenceDataset

    specs = {"obs": {"low_dim": list(low), "rgb": list(rgb)}}
    obs_utils.initialize_obs_utils_with_obs_specs(specs)
    return SequenceDataset(
        hdf5_path=str(export),
        obs_keys=[*low, *rgb],
        dataset_keys=["actions", "rewards", "dones"],
        load_next_obs=False,
        **options,
    )


def check(export: Path, roots: Sequence[Path], *, train: bool = True) -> dict[str, Any]:
    """Load everything; returns what was found.

    Raises:
        MismatchError: something is not as collected.
    """
    make_importable()
    rgb = picture_keys(export)
    low: list[str] = []
    for original in originals(roots):
        low = sorted(expected_observations(original))
        break
    data = loader(export, low, list(rgb.values()), seq_length=1)
    report = {"frames": len(data), **_compare(export, data, roots, rgb)}
    report |= _split(export, low)
    if train:
        report["loss, low-dimensional BC-RNN"] = _train(export, low, [])
        if rgb:
            report["loss, BC-RNN with pictures"] = _train(export, low, list(rgb.values()), 2, 2)
    return report


def _compare(export: Path, data: Any, roots: Sequence[Path], rgb: dict[str, str]) -> dict[str, Any]:
    scale, offset = _scaling(export)
    numbers, pictures, place = 0, 0, 0
    for original in originals(roots):
        seen, actions = expected_observations(original), expected_actions(original)
        if scale is not None:
            # Single precision there and back.
            actions = ((actions - offset) / scale).clip(-1.0, 1.0)
        for frame in range(original.frames):
            item = data[place]
            for key, values in seen.items():
                numbers += same(f"{key}, frame {place}", item["obs"][key][0], values[frame])
            numbers += same(f"actions, frame {place}", item["actions"][0], actions[frame])
            last = frame == original.frames - 1
            for key in ("rewards", "dones"):
                numbers += same(f"{key}, frame {place}", item[key], [float(last)])
            for eye, key in rgb.items():
                got = item["obs"][key][0]
                expected = original.picture(eye, frame, got.shape[1::-1])
                pictures += same(f"{key}, frame {place}", got, expected) > 0
            place += 1
    if place != len(data):
        raise MismatchError(f"expected {place} frames, got {len(data)}")
    return {"numbers equal": numbers, "pictures equal": pictures}


def _scaling(export: Path) -> tuple[Any, Any]:
    with h5py.File(export, "r") as file:
        about = file["data"].attrs
        return about.get("action_scale"), about.get("action_offset")


def _split(export: Path, low: Sequence[str]) -> dict[str, Any]:
    """Both parts of the split, as robomimic's training script opens them."""
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
    """First and last loss of a few steps of robomimic's BC-RNN; it must fall or stay finite."""
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
    # Two steps with pictures only show that they go through.
    if not np.isfinite(losses).all() or (steps >= STEPS and not falls):
        raise MismatchError(f"training does not work: losses {losses}")
    return [round(losses[0], 4), round(losses[-1], 4)]


if __name__ == "__main__":
    for name, found in check(Path(sys.argv[1]), [Path(text) for text in sys.argv[2:]]).items():
        print(f"= {name:<32} {found}")
