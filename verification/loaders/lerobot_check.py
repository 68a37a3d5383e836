"""Load an export with lerobot's own classes, compare every number and pixel, and train a little.

python -m verification.loaders.lerobot_check EXPORT DATASET [DATASET ...]
"""

import json
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from verification.loaders.collected import (
    EYES,
    RATE,
    CollectedEpisode,
    MismatchError,
    check_equal,
    collected_episodes,
    held_gaits,
    psnr,
)
from verification.loaders.torchvision_shim import declare_torchvision_operators

WORST_PSNR = 30.0
"""Limit for the pictures of a video [dB]; at the usual size and quality they reach 36."""
CHUNK = 10
STEPS = 4
_STATE = ("poses", "gripper_closure", "joint_sin_cos", "joint_velocity", "control_state")
_ACTION = ("hands", "grasp", "locomotion", "neck")
_AGES = ("state", "controller", "truth", "seen")


def loader(export: Path, **options: Any) -> Any:
    """Open the export as a lerobot data set."""
    # A missing file must be an error, not a download.
    os.environ["HF_HUB_OFFLINE"] = "1"
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    return LeRobotDataset("trill/export", root=export, video_backend="pyav", **options)


def check(export: Path, roots: Sequence[Path], *, train: bool = True) -> dict[str, Any]:
    """Load everything, compare it and return a report.

    Raises:
        MismatchError: the loader returned something else than was collected.
    """
    declare_torchvision_operators()
    data = loader(export)
    if data.meta.fps != RATE or data.meta.robot_type != "draco3":
        raise MismatchError(f"wrong description: {data.meta.fps} Hz, {data.meta.robot_type}")
    eyes = [eye for eye in EYES if f"observation.images.{eye}" in data.meta.camera_keys]
    report = {"frames": len(data), **_compare(data, roots, eyes)}
    report |= _statistics(data)
    report |= _scaled_by_quantiles(data)
    report |= _modality(export, data)
    report |= _windows(export, data, eyes)
    if train:
        report["loss, ACT"] = _train(export, data)
    return report


def _compare(data: Any, roots: Sequence[Path], eyes: Sequence[str]) -> dict[str, Any]:
    numbers, place = 0, 0
    held = json.loads((data.root / "meta/trill.json").read_text())["gait"] == "held"
    noise: dict[str, list[float]] = {eye: [] for eye in eyes}
    for number, episode in enumerate(collected_episodes(roots)):
        parts = {
            "observation.state": _state(episode, data.meta.features["observation.state"]["names"]),
            "action": _action(episode, held=held),
        } | {f"age.{name}": episode.array(f"age/{name}")[:, 0] for name in _AGES}
        for frame in range(episode.frames):
            item = data[place]
            last = frame == episode.frames - 1
            expected = {key: values[frame] for key, values in parts.items()}
            expected |= {"frame_index": frame, "episode_index": number, "index": place}
            expected |= {"next.reward": float(last), "next.done": last, "next.success": last}
            expected |= {"timestamp": np.float32(frame / RATE)}
            for key, value in expected.items():
                numbers += check_equal(f"{key}, frame {place}", item[key].numpy(), value)
            if not item["task"].endswith("."):
                raise MismatchError(f"expected a sentence as task, got {item['task']!r}")
            for eye in eyes:
                noise[eye].append(_picture_noise(item, episode, eye, frame))
            place += 1
    if place != len(data):
        raise MismatchError(f"expected {place} frames, got {len(data)}")
    report: dict[str, Any] = {"numbers equal": numbers}
    for eye, values in noise.items():
        report[f"PSNR, {eye} eye [dB]"] = f"{np.mean(values):.1f}, worst {min(values):.1f}"
    return report


def _state(episode: CollectedEpisode, names: Sequence[str]) -> Any:
    """Return the columns (frames, columns) that have these names in the export."""
    every = _joined(episode, "observation", _STATE)
    prefixes = {"gripper_closure": "{}_gripper", "joint_velocity": "velocity.{}"}
    known: list[str] = []
    for part in _STATE[:-1]:
        form = prefixes.get(part, "{}")
        known += [form.format(name) for name in episode.names(f"observation/{part}")]
    known.append("control_state")
    return every[:, [known.index(name) for name in names]]


def _action(episode: CollectedEpisode, *, held: bool) -> Any:
    actions = _joined(episode, "action", _ACTION)
    if held:
        states = episode.array("observation/control_state")[:, 0]
        actions[:, 16] = held_gaits(actions[:, 16], states)
    return actions


def _joined(episode: CollectedEpisode, group: str, names: Sequence[str]) -> Any:
    return np.concatenate([episode.array(f"{group}/{name}") for name in names], axis=1)


def _picture_noise(item: dict[str, Any], episode: CollectedEpisode, eye: str, frame: int) -> float:
    picture = item[f"observation.images.{eye}"].numpy().transpose(1, 2, 0)
    got = (picture * 255).round().astype(np.uint8)
    noise = psnr(got, episode.picture(eye, frame, got.shape[1::-1]))
    if noise < WORST_PSNR:
        raise MismatchError(f"{eye} eye, frame {frame}: {noise:.1f} dB, expected {WORST_PSNR}")
    return noise


def _statistics(data: Any) -> dict[str, Any]:
    """Compare the statistics by which lerobot scales with those of the frames it loads."""
    table = data.hf_dataset.data
    for key in ("observation.state", "action"):
        values, stats = np.array(table[key].to_pylist()), data.meta.stats[key]
        for name, expected in (
            ("min", values.min(axis=0)),
            ("max", values.max(axis=0)),
            ("mean", values.mean(axis=0)),
            ("std", values.std(axis=0)),
        ):
            if not np.allclose(stats[name], expected, rtol=1e-5, atol=1e-6):
                raise MismatchError(f"stats of {key}: {name} is {stats[name]}, not {expected}")
        if stats["count"] != len(values):
            raise MismatchError(f"stats of {key}: count is {stats['count']}, not {len(values)}")
    for key in data.meta.camera_keys:
        if np.shape(data.meta.stats[key]["mean"]) != (3, 1, 1):
            raise MismatchError(f"stats of {key}: {data.meta.stats[key]}")
    return {"statistics": "correct"}


def _scaled_by_quantiles(data: Any) -> dict[str, Any]:
    """Scale every frame between q01 and q99, as lerobot does, and look how far it goes."""
    import torch
    from lerobot.configs.types import FeatureType, NormalizationMode, PolicyFeature
    from lerobot.processor import NormalizerProcessorStep

    keys = {"observation.state": FeatureType.STATE, "action": FeatureType.ACTION}
    features = {
        key: PolicyFeature(kind, tuple(data.meta.features[key]["shape"]))
        for key, kind in keys.items()
    }
    modes = dict.fromkeys(keys.values(), NormalizationMode.QUANTILES)
    step = NormalizerProcessorStep(features=features, norm_map=modes, stats=data.meta.stats)
    table, worst = data.hf_dataset.data, 0.0
    for key, kind in keys.items():
        values = torch.tensor(np.array(table[key].to_pylist(), dtype=np.float32))
        scaled = step._apply_transform(values, key, kind)
        worst = max(worst, float(scaled.abs().max()))
    # Quantiles a hundredth of the range apart leave twice a hundred.
    if not worst <= 201.0:
        raise MismatchError(f"scaled between q01 and q99 a number becomes {worst:g}")
    return {"largest number scaled by quantiles": round(worst, 2)}


def _modality(export: Path, data: Any) -> dict[str, Any]:
    """Check that GR00T's description covers state and action without gap or overlap."""
    about = json.loads((export / "meta/modality.json").read_text())
    for name, key in (("state", "observation.state"), ("action", "action")):
        at = 0
        for part, span in sorted(about[name].items(), key=lambda item: item[1]["start"]):
            if span["start"] != at or span["end"] <= at:
                raise MismatchError(f"modality.json: {name} {part} is at {span}, expected {at}")
            at = span["end"]
        if at != data.meta.features[key]["shape"][0]:
            raise MismatchError(f"modality.json: {name} ends at {at}")
    shown = {video["original_key"] for video in about["video"].values()}
    if shown != set(data.meta.camera_keys):
        raise MismatchError(f"modality.json: pictures {shown}, expected {data.meta.camera_keys}")
    return {"modality.json": "covers state, action and pictures"}


def middle_frame(data: Any) -> int:
    """Return the index of a frame near the middle that is not the first of its episode."""
    at = len(data) // 2
    return at + (int(data[at]["frame_index"]) == 0)


def _windows(export: Path, data: Any, eyes: Sequence[str]) -> dict[str, Any]:
    """Check windows of several frames, as policies with a history and an action chunk use them."""
    import torch

    times = {"action": [step / RATE for step in range(CHUNK)], "observation.state": [-0.05, 0.0]}
    times |= {f"observation.images.{eye}": [-0.05, 0.0] for eye in eyes}
    windows = loader(export, delta_timestamps=times)
    at = middle_frame(data)
    item = windows[at]
    for step in range(CHUNK):
        if not bool(item["action_is_pad"][step]):
            check_equal(f"action {step} ahead", item["action"][step], data[at + step]["action"])
    for eye in eyes:
        key = f"observation.images.{eye}"
        before, now = item[key].numpy()
        if psnr(before * 255, data[at - 1][key].numpy() * 255) < 60.0:
            raise MismatchError(f"{key}: expected the previous picture")
        if psnr(now * 255, data[at][key].numpy() * 255) < 60.0:
            raise MismatchError(f"{key}: expected the current picture")
    batch = next(iter(torch.utils.data.DataLoader(windows, batch_size=8, shuffle=True)))
    expected = (8, CHUNK, 18)
    if tuple(batch["action"].shape) != expected:
        raise MismatchError(f"a batch's actions: expected {expected}, got {batch['action'].shape}")
    return {"a batch of actions": expected}


def _train(export: Path, data: Any) -> Any:
    """Train a small ACT of lerobot for a few steps; return its losses, or why it cannot be."""
    import torch

    try:
        from lerobot.policies.act.configuration_act import ACTConfig
        from lerobot.policies.act.modeling_act import ACTPolicy
        from lerobot.policies.factory import make_pre_post_processors
    except ImportError as error:
        return f"not tried: {error}"
    from lerobot.configs.types import FeatureType, PolicyFeature

    torch.manual_seed(0)
    shapes = {key: tuple(about["shape"]) for key, about in data.meta.features.items()}
    seen = {"observation.state": PolicyFeature(FeatureType.STATE, shapes["observation.state"])}
    for key in data.meta.camera_keys:
        height, width, colours = shapes[key]
        seen[key] = PolicyFeature(FeatureType.VISUAL, (colours, height, width))
    config = ACTConfig(
        input_features=seen,
        output_features={"action": PolicyFeature(FeatureType.ACTION, shapes["action"])},
        pretrained_backbone_weights=None,
        chunk_size=CHUNK,
        n_action_steps=CHUNK,
        dim_model=64,
        dim_feedforward=128,
        n_heads=4,
        device="cpu",
    )
    policy = ACTPolicy(config)
    before, _ = make_pre_post_processors(config, dataset_stats=data.meta.stats)
    times = {"action": [step / RATE for step in config.action_delta_indices]}
    windows = loader(export, delta_timestamps=times)
    batches = iter(torch.utils.data.DataLoader(windows, batch_size=4, shuffle=True))
    optimiser = torch.optim.AdamW(policy.parameters(), lr=1e-3)
    losses = []
    for _ in range(STEPS):
        loss, _ = policy.forward(before(next(batches)))
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(round(float(loss.detach()), 3))
    if not np.isfinite(losses).all() or min(losses[1:]) >= losses[0]:
        raise MismatchError(f"training does not work: losses {losses}")
    return losses


if __name__ == "__main__":
    for name, found in check(Path(sys.argv[1]), [Path(text) for text in sys.argv[2:]]).items():
        print(f"= {name:<32} {found}")
