"""The network and the loss of TRILL."""

import torch
from torch import Tensor, nn
from torch.nn.functional import binary_cross_entropy_with_logits, cross_entropy

from services.policy.networks.continuous import Outputs, continuous_output
from services.policy.networks.policy import (
    DecisionBatch,
    PolicyNetwork,
    TargetBatch,
    Terms,
    mean_over,
)
from services.policy.processor.targets import GAITS
from services.policy.trill.configuration import TrillConfig


class TrillNetwork(PolicyNetwork):
    """Separate outputs: a mixture for the hands, the grippers, the gait trigger and its type."""

    config: TrillConfig

    def __init__(self, config: TrillConfig) -> None:
        super().__init__(config)
        given, steps = config.mlp[-1], config.actions.shape[0]
        self._shape = config.actions.shape
        self.hands = continuous_output(
            given, steps * self._shape[1], config.mixture, deterministic=config.deterministic
        )
        self.grasp = nn.Linear(given, steps * 2)
        self.trigger = None if config.categorical else nn.Linear(given, 1)
        # Without a trigger, no gait is one of the choices.
        self.gait = nn.Linear(given, GAITS if config.categorical else GAITS - 1)

    def outputs(self, features: Tensor) -> Outputs:
        """Return ``mean``, ``std``, ``mode``, and logits: ``grasp``, ``trigger``, ``gait``."""
        found: Outputs = self.hands(features) | {
            "grasp": self.grasp(features).float().unflatten(-1, (-1, 2)),
            "gait": self.gait(features).float(),
        }
        if self.trigger is not None:
            found["trigger"] = self.trigger(features).float().squeeze(-1)
        return found

    def terms(self, outputs: Outputs, targets: TargetBatch) -> Terms:
        """Return ``hands``, ``grasp``, ``trigger`` and ``gait``, all in nats.

        ``hands`` is the negative log-likelihood of a set-point, so that chunks weigh no more than
        single ones; ``grasp`` the cross-entropy of a gripper; ``trigger`` that of asking for a
        gait, over the frames that count; ``gait`` that of its type, over the frames that ask.
        """
        hands = self.hands.loss(outputs, targets.hands.flatten(-2)) / self._shape[0]
        grasp = binary_cross_entropy_with_logits(outputs["grasp"], targets.grasp, reduction="none")
        terms = {
            "hands": mean_over(hands, targets.valid),
            "grasp": mean_over(grasp.mean((-2, -1)), targets.valid),
        }
        counts = targets.valid & targets.gait_counts
        if "trigger" not in outputs:
            return terms | {"gait": mean_over(_choice(outputs["gait"], targets.gait), counts)}
        asked = targets.gait > 0
        trigger = binary_cross_entropy_with_logits(
            outputs["trigger"], asked.to(outputs["trigger"].dtype), reduction="none"
        )
        kind = _choice(outputs["gait"], (targets.gait - 1).clamp(min=0))
        return terms | {
            "trigger": mean_over(trigger, counts),
            "gait": mean_over(kind, counts & asked),
        }

    def decide(self, outputs: Outputs) -> DecisionBatch:
        """Return the mean of the likeliest mode and the probabilities of grippers and gaits."""
        gait = outputs["gait"].softmax(-1)
        if "trigger" in outputs:
            trigger = outputs["trigger"].sigmoid().unsqueeze(-1)
            gait = torch.cat((1.0 - trigger, trigger * gait), dim=-1)
        return DecisionBatch(
            self.hands.decide(outputs).unflatten(-1, self._shape),
            outputs["grasp"].sigmoid(),
            gait,
        )


def _choice(logits: Tensor, target: Tensor) -> Tensor:
    """Return the cross-entropy (...) of choices (...) under ``logits`` (..., n)."""
    return cross_entropy(logits.flatten(0, -2), target.flatten(), reduction="none").view(
        target.shape
    )
