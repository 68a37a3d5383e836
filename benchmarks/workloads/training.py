"""Trains this project's BC-RNN on random demonstrations in turns; see ``bench_training.py``.

python -m benchmarks.workloads.training WORK.json PRECISION
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.workloads.turns import own_stdout, take_turns
from common.episodes.columns import COLUMNS
from lab.learning.training.config import TrainingConfig
from lab.learning.training.learner import Learner, mixed_precision
from lab.learning.training.memory import keep_freed_memory
from lab.learning.training.windows import Windows, observation_spread
from services.policy.bc_rnn.configuration import BcRnnConfig
from services.policy.kinds import network
from services.policy.processor.processor import Processor


def episode(rng: np.random.Generator, frames: int) -> dict[str, Any]:
    """Return the columns of a demonstration in which everything moves at random."""
    arrays: dict[str, Any] = {}
    for column in (column for column in COLUMNS if not column.varies):
        values = rng.normal(size=(frames, *column.shape))
        for index, name in enumerate(column.names):
            if name.endswith((".qw", ".qx", ".qy", ".qz")):
                values[:, index] = name.endswith(".qw")
        if np.dtype(column.dtype).kind != "f":
            values = np.zeros_like(values)
        arrays[column.path] = values.astype(column.dtype)
    return arrays


def main() -> int:
    """Prepare, and take turns."""
    out = own_stdout()
    work = json.loads(Path(sys.argv[1]).read_text())
    torch.set_num_threads(1)
    keep_freed_memory()
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    policy = BcRnnConfig.model_validate(work["policy"])
    config = TrainingConfig(
        batch=work["batch"],
        window=work["window"],
        precision=sys.argv[2],  # type: ignore[arg-type]
    )
    episodes = [episode(rng, work["frames"]) for _ in range(work["episodes"])]
    processor = Processor.fit(policy, episodes)
    width, height = policy.inputs.picture_size
    shape = (work["episodes"] * work["frames"], len(policy.inputs.cameras), height, width, 3)
    pictures = rng.integers(0, 255, shape, dtype=np.uint8)
    windows = Windows(processor, episodes, pictures, config)
    spread = observation_spread(processor, config.noise)
    device = torch.device("cpu")
    learner = Learner(network(policy), config, device)

    def steps(count: int) -> float:
        batches = (windows.draw(rng, config.batch, spread) for _ in range(count))
        return float(np.mean([learner.learn(batch, 0.0)["loss"] for batch in batches]))

    bits = "bfloat16" if mixed_precision(config, device, looking=True) else "float32"
    parameters = sum(p.numel() for p in learner.network.parameters())
    take_turns(out, {"name": f"trill, {bits}", "parameters": parameters}, steps)
    return 0


if __name__ == "__main__":
    sys.exit(main())
