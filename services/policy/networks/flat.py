"""The flat output of the baselines: everything a set-point has is one vector of numbers."""

from math import sqrt

import torch
from torch import Tensor

from services.policy.configuration import PolicySettings
from services.policy.networks.continuous import Outputs, continuous_output
from services.policy.networks.policy import (
    DecisionBatch,
    PolicyNetwork,
    TargetBatch,
    Terms,
    mean_over,
)
from services.policy.processor.targets import GAITS


class FlatNetwork(PolicyNetwork):
    """One distribution of hands, grippers and locomotion, as in the paper's baselines.

    After the normalised actions of the hands come the grippers, -1 open and 1 closed, and the
    number of the gait from -1 (none) to 1 (the last one).
    """

    def __init__(self, config: PolicySettings) -> None:
        super().__init__(config)
        self._shape = config.actions.shape
        steps, numbers = self._shape
        self._split = [steps * numbers, steps * 2, 1]
        self.flat = continuous_output(
            config.mlp[-1], sum(self._split), config.mixture, deterministic=config.deterministic
        )

    def outputs(self, features: Tensor) -> Outputs:
        """Return ``mean`` and, of a mixture, ``mode`` and ``std``."""
        found: Outputs = self.flat(features)
        return found

    def terms(self, outputs: Outputs, targets: TargetBatch) -> Terms:
        """Return the one term, ``hands``, of a set-point with all that belongs to it [nats]."""
        gait = targets.gait.to(targets.hands.dtype)
        vector = torch.cat(
            (
                targets.hands.flatten(-2),
                2.0 * targets.grasp.flatten(-2) - 1.0,
                (2.0 * gait / (GAITS - 1) - 1.0).unsqueeze(-1),
            ),
            dim=-1,
        )
        loss = self.flat.loss(outputs, vector) / self._shape[0]
        return {"hands": mean_over(loss, targets.valid)}

    def decide(self, outputs: Outputs) -> DecisionBatch:
        """Return the likeliest vector's hands and grippers, and how probable each gait is.

        A gait is asked for in one frame of dozens, so that the likeliest vector never asks for
        one. A vector drawn from the mixture, as in the paper, would as often as the mixture says.
        """
        hands, grasp, gait = self.flat.decide(outputs).split(self._split, dim=-1)
        return DecisionBatch(
            hands.unflatten(-1, self._shape),
            ((grasp + 1.0) / 2.0).clamp(0.0, 1.0).unflatten(-1, (-1, 2)),
            _gaits(outputs, gait.squeeze(-1)),
        )


def _gaits(outputs: Outputs, regressed: Tensor) -> Tensor:
    """Return the probabilities (..., 7) that the number of the gait is nearest to each gait's.

    Args:
        outputs: of the distribution, whose last number is the gait's.
        regressed: (...) that number; without a mixture it is certain.
    """
    # Halfway between the numbers of neighbouring gaits; beyond the first and last there is none.
    numbers = torch.arange(1, GAITS, dtype=regressed.dtype, device=regressed.device)
    edges = (2.0 * numbers - 1.0) / (GAITS - 1) - 1.0
    if "std" not in outputs:
        below = (regressed.unsqueeze(-1) < edges).to(regressed.dtype)
    else:
        mean, std = (outputs[name][..., -1, None] for name in ("mean", "std"))
        weight = outputs["mode"].softmax(-1).unsqueeze(-1)
        # The normal distribution, in terms that ONNX has, as the differences below.
        normal = 0.5 + 0.5 * torch.erf((edges - mean) / (std * sqrt(2.0)))
        below = (weight * normal).sum(-2)
    none, all_of_it = torch.zeros_like(below[..., :1]), torch.ones_like(below[..., :1])
    return torch.cat((below, all_of_it), dim=-1) - torch.cat((none, below), dim=-1)
