"""A small policy with random weights, and invented results."""

from pathlib import Path
from typing import Any

from lab.learning.evaluation.plan import policy_spec
from lab.trials.operators.specs import PolicySpec
from lab.trials.spec import TrialResult, TrialSpec
from services.policy.checkpoint.manifest import Origin, describe
from services.policy.configuration import ChunkConfig, InputConfig
from services.policy.kinds import network
from services.policy.processor.processor import Processor
from tests.services.policy.made import SIZE, episode, small

UNLOCK = "door/unlock"


def checkpoint(folder: Path, vision: str = "blind") -> Path:
    """Write a checkpoint of random weights; its pictures are of 64x48."""
    import torch

    from services.policy.checkpoint.folder import save_checkpoint

    torch.set_num_threads(1)
    torch.manual_seed(0)
    inputs = InputConfig.model_validate({"vision": vision, "picture_size": SIZE})
    config = small("trill", inputs=inputs, actions=ChunkConfig())
    origin = Origin(
        dataset="d" * 64,
        episodes=3,
        source="s" * 64,
        versions={},
        operator="synthetic",
        task=UNLOCK,
        picture_size=(64, 48),
    )
    processor = Processor.fit(config, [episode(seed) for seed in range(3)])
    save_checkpoint(folder, network(config), processor, origin)
    return folder


def operator_of(folder: Path, **serving: Any) -> PolicySpec:
    return policy_spec(folder, describe(folder), serving)


def trial(operator: PolicySpec, seed: int = 0, **more: Any) -> TrialSpec:
    return TrialSpec(task=UNLOCK, seed=seed, operator=operator, physics_steps=5, **more)


def invented(label: str, episodes: int = 3, kind: str = "trill", **policy: Any) -> PolicySpec:
    """Return a policy of which there is no checkpoint."""
    about = {
        "policy": {"kind": kind, "inputs": {"vision": "stereo"}} | policy,
        "origin": {"episodes": episodes},
    }
    return PolicySpec(checkpoint="none", digest=f"{label} {episodes}", label=label, about=about)


def result(seed: int, verdict: str = "success", time: float = 8.0, **more: Any) -> TrialResult:
    values = {"task": UNLOCK, "seed": seed, "verdict": verdict, "time": time, "reason": verdict}
    return TrialResult.model_validate(values | more)
