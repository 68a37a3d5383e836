"""Trains robomimic's BC-RNN-GMM on random demonstrations in turns; see ``bench_training.py``.

    PEER_PYTHON -m benchmarks.workloads.robomimic_training WORK.json

Needs robomimic in an interpreter of its own. Everything that is measured is robomimic's: data set,
loader, network and the loop around them, with its fastest cache; only the sizes are set. Where
torchvision's compiled operators are not those of the installed torch, two that it wants to find
when it is imported are declared, and would fail if they were called. They belong to the detection
of objects; the network here is torchvision's ResNet18, which is made of torch's own operators.
"""

import json
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import torch

from benchmarks.workloads.turns import own_stdout, take_turns

PICTURES = ("left", "right")


def import_torchvision() -> Any:
    """Import torchvision; returns what has to live as long as it does."""
    try:
        import_module("torchvision")
    except RuntimeError:
        library = torch.library.Library("torchvision", "DEF")
        for name in ("nms", "qnms"):
            library.define(f"{name}(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")
        for name in [name for name in sys.modules if name.partition(".")[0] == "torchvision"]:
            del sys.modules[name]
        import_module("torchvision")
        return library
    return None


def write_demonstrations(path: Path, work: dict[str, Any]) -> None:
    """Write random demonstrations in robomimic's format."""
    rng = np.random.default_rng(0)
    frames = work["frames"]
    width, height = work["policy"]["inputs"]["picture_size"]
    with h5py.File(path, "w") as file:
        for index in range(work["episodes"]):
            group = file.create_group(f"data/demo_{index}")
            group.attrs["num_samples"] = frames
            for name, columns in (("actions", work["action"]), ("obs/state", work["observation"])):
                group[name] = rng.uniform(-1.0, 1.0, (frames, columns)).astype(np.float32)
            for name in ("rewards", "dones"):
                group[name] = np.zeros(frames)
            for camera in PICTURES:
                shape = (frames, height, width, 3)
                group[f"obs/{camera}"] = rng.integers(0, 255, shape, dtype=np.uint8)


def configuration(work: dict[str, Any], path: Path) -> Any:
    """Return robomimic's configuration of BC-RNN-GMM with the sizes of ``work``."""
    from robomimic.config import config_factory

    policy, config = work["policy"], config_factory("bc")
    encoder = policy["encoder"]
    with config.values_unlocked():
        config.train.data = str(path)
        config.train.batch_size = work["batch"]
        config.train.seq_length = config.algo.rnn.horizon = work["window"]
        config.train.hdf5_use_swmr = False
        config.train.hdf5_cache_mode = "all"
        config.observation.modalities.obs.low_dim = ["state"]
        config.observation.modalities.obs.rgb = list(PICTURES)
        kwargs = config.observation.encoder.rgb.core_kwargs
        kwargs.feature_dimension = encoder["features"]
        kwargs.backbone_class, kwargs.pool_class = "ResNet18Conv", "SpatialSoftmax"
        kwargs.backbone_kwargs.pretrained = False
        kwargs.pool_kwargs.num_kp = encoder["key_points"]
        config.algo.actor_layer_dims = tuple(policy["mlp"])
        config.algo.gmm.enabled = config.algo.rnn.enabled = True
        config.algo.gmm.num_modes = policy["mixture"]["modes"]
        config.algo.rnn.hidden_dim = policy["memory"]["hidden"]
        config.algo.rnn.num_layers = policy["memory"]["layers"]
    return config


def main() -> int:
    """Prepare, and take turns."""
    out = own_stdout()
    source = Path(sys.argv[1])
    work = json.loads(source.read_text())
    torch.set_num_threads(1)
    torch.manual_seed(0)
    kept = import_torchvision()
    import robomimic
    from robomimic.algo import algo_factory
    from robomimic.utils import obs_utils, train_utils

    path = source.with_suffix(".hdf5")
    write_demonstrations(path, work)
    config = configuration(work, path)
    obs_utils.initialize_obs_utils_with_config(config)
    width, height = work["policy"]["inputs"]["picture_size"]
    shapes = {"state": (work["observation"],), **dict.fromkeys(PICTURES, (3, height, width))}
    model = algo_factory("bc", config, shapes, work["action"], torch.device("cpu"))
    data = train_utils.dataset_factory(config, obs_keys=list(shapes))
    loader = torch.utils.data.DataLoader(
        data, config.train.batch_size, shuffle=True, drop_last=True
    )

    def steps(count: int) -> float:
        log = train_utils.run_epoch(model, loader, epoch=1, num_steps=count)
        return float(log["Loss"])

    parameters = sum(p.numel() for p in model.nets.parameters())
    name = f"robomimic {robomimic.__version__}, float32"
    take_turns(out, {"name": name, "parameters": parameters}, steps)
    del kept
    return 0


if __name__ == "__main__":
    sys.exit(main())
