"""Names an estimator of the scene by everything that decides what it has learned.

Policies of all kinds that see alike learn the same estimator from the same demonstrations, and
rendering its views takes most of the time of a training from pictures.
"""

import hashlib
import json

import torch

from lab.learning.training.config import TrainingConfig
from lab.trials.provenance import code_version
from services.policy.configuration import PolicySettings

_MODULES = ("lab.learning.training.views", "lab.learning.training.estimator")
_PACKAGES = ("torch", "numpy", "mujoco", "opencv-python-headless")


def estimator_key(
    task: str,
    dataset: str,
    policy: PolicySettings,
    training: TrainingConfig,
    device: torch.device,
) -> str:
    """Return the same text for estimators with the same weights.

    Args:
        task: of the demonstrations.
        dataset: digest of the demonstrations.
        policy: settings of the policy; only what it sees and how its encoders are made counts.
        training: settings of training; only its views, its seed and what it holds out count.
        device: on which it is trained.
    """
    inputs = policy.inputs
    code = code_version(*_MODULES, packages=_PACKAGES)
    about = {
        "task": task,
        "dataset": dataset,
        "sees": [inputs.cameras, inputs.picture_size, inputs.estimated],
        "encoder": policy.encoder.model_dump(mode="json"),
        "estimator": policy.estimator.model_dump(mode="json"),
        "views": training.views.model_dump(mode="json"),
        "drawn": [training.seed, training.held_out],
        "device": device.type,
        "code": code.model_dump(mode="json", exclude={"revision"}),
    }
    return hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()
