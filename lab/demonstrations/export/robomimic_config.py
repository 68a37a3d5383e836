"""Writes a configuration beside a robomimic export, with which robomimic's own script trains.

``python -m robomimic.scripts.train --config FILE`` takes it as it is: behaviour cloning with a
recurrent network, the export's observations, training and validation by its masks, no rollouts,
since there is no environment for robomimic.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from lab.errors import DatasetError

_SEQUENCE = 10
"""Frames of a training sequence, half a second."""
_BATCH, _BATCH_WITH_PICTURES = 100, 16
_EPOCH = 100
"""Training steps from one validation and checkpoint to the next."""


def config_path(out: Path) -> Path:
    """Return the path of the configuration of the export ``out``."""
    return out.with_name(f"{out.name.removesuffix('.hdf5')}.config.json")


def check_free(out: Path) -> None:
    """Check that the configuration's place is free, or has one for the same export.

    Raises:
        DatasetError: something else is there.
    """
    path = config_path(out)
    try:
        ours = json.loads(path.read_bytes())["train"]["data"] == str(out.resolve())
    except FileNotFoundError:
        return
    except (OSError, ValueError, KeyError, TypeError):
        ours = False
    if not ours:
        raise DatasetError(
            f"{path} exists and is no configuration for {out}, so it is not replaced; choose "
            "another --out"
        )


def write_config(
    out: Path,
    *,
    low_dim: Sequence[str],
    rgb: Sequence[str],
    frames: dict[str, int],
    next_obs: bool,
) -> Path:
    """Write the configuration and return its path.

    Args:
        out: the export.
        low_dim: keys of its numbers.
        rgb: keys of its pictures.
        frames: number of frames of the masks ``train`` and ``valid``.
        next_obs: whether the export has the observations after each action.

    Raises:
        DatasetError: it cannot be written.
    """
    path = config_path(out)
    content = _content(out.resolve(), low_dim, rgb, frames, next_obs)
    try:
        path.write_text(json.dumps(content, indent=4) + "\n", encoding="utf-8")
    except OSError as error:
        raise DatasetError(f"{path} cannot be written: {error.strerror}") from error
    return path


def _content(
    out: Path, low_dim: Sequence[str], rgb: Sequence[str], frames: dict[str, int], next_obs: bool
) -> dict[str, Any]:
    validate = frames["valid"] > 0
    parts = [count for count in frames.values() if count]
    experiment = {
        "name": out.name.removesuffix(".hdf5"),
        "validate": validate,
        "rollout": {"enabled": False},
        "render_video": False,
        "epoch_every_n_steps": _EPOCH,
        "validation_epoch_every_n_steps": 10,
        "save": {
            "every_n_epochs": 20,
            "on_best_validation": validate,
            "on_best_rollout_return": False,
            "on_best_rollout_success_rate": False,
        },
    }
    train = {
        "data": str(out),
        "output_dir": str(out.with_name(f"{out.name.removesuffix('.hdf5')}.runs")),
        "hdf5_filter_key": "train",
        "hdf5_validation_filter_key": "valid" if validate else None,
        "hdf5_load_next_obs": next_obs,
        # robomimic normalises observations only without a validation mask.
        "hdf5_normalize_obs": False,
        "hdf5_cache_mode": "low_dim" if rgb else "all",
        "seq_length": _SEQUENCE,
        # A batch larger than a mask would leave nothing to train or validate with.
        "batch_size": min([_BATCH_WITH_PICTURES if rgb else _BATCH, *parts]),
    }
    return {
        "algo_name": "bc",
        "experiment": experiment,
        "train": train,
        "algo": {"rnn": {"enabled": True, "horizon": _SEQUENCE}},
        "observation": {"modalities": {"obs": {"low_dim": list(low_dim), "rgb": list(rgb)}}},
    }
