"""A policy of random weights that waves its hands a little and now and then takes a step."""

from pathlib import Path

import torch

from services.policy.checkpoint.folder import save_checkpoint
from services.policy.checkpoint.manifest import Origin
from services.policy.configuration import ChunkConfig, InputConfig
from services.policy.kinds import CONFIGS, network
from services.policy.processor.processor import Processor
from services.policy.processor.statistics import Statistics

_HOME = (0.3, 0.2, 0.05, 0.0, 0.0, 0.0, 0.3, -0.2, 0.05, 0.0, 0.0, 0.0, 0.0)
"""Mean of the set-points: each hand ahead, position [m] and rotation vector [rad]; the neck."""
_SPREAD = 0.03
"""Scale of the set-points [m, rad]."""


def random_policy(folder: Path) -> Path:
    """Write a checkpoint that sees no pictures; return its folder."""
    torch.manual_seed(0)
    inputs, actions = InputConfig(vision="blind", picture_size=(60, 45)), ChunkConfig()
    config = (
        CONFIGS["trill"].profile("cpu").model_copy(update={"inputs": inputs, "actions": actions})
    )
    width = inputs.measured_width
    processor = Processor(
        inputs=inputs,
        actions=actions,
        hazard_frames=8,
        observation=Statistics(mean=(0.0,) * width, scale=(1.0,) * width),
        action=Statistics(mean=_HOME, scale=(_SPREAD,) * len(_HOME)),
    )
    origin = Origin(dataset="none", episodes=0, source="none", versions={}, operator="nobody")
    save_checkpoint(folder, network(config), processor, origin)
    return folder
