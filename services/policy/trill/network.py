"""The network and the loss of TRILL."""

from itertools import pairwise

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
from services.policy.trill.configuration import GaitNetworkConfig, TrillConfig


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
        # Without a trigger, no gait is one of the choices.
        gaits = GAITS if config.categorical else GAITS - 1
        self.trigger = self.gait = self.gait_network = None
        if config.gait_network is not None:
            self.gait_network = GaitNetwork(config.gait_network, config, gaits)
        else:
            self.trigger = None if config.categorical else nn.Linear(given, 1)
            self.gait = nn.Linear(given, gaits)

    def outputs(self, features: Tensor) -> Outputs:
        """Return ``mean``, ``std``, ``mode``, and logits: ``grasp``, ``trigger``, ``gait``."""
        found: Outputs = self.hands(features) | {
            "grasp": self.grasp(features).float().unflatten(-1, (-1, 2))
        }
        if self.gait is not None:
            found["gait"] = self.gait(features).float()
        if self.trigger is not None:
            found["trigger"] = self.trigger(features).float().squeeze(-1)
        return found

    def frame_outputs(self, frames: Tensor) -> Outputs:
        """Return the logits ``trigger`` and ``gait`` if they have a network of their own."""
        return {} if self.gait_network is None else self.gait_network(frames)

    def terms(self, outputs: Outputs, targets: TargetBatch) -> Terms:
        """Return ``hands``, ``grasp``, ``trigger`` and ``gait``, all in nats.

        ``hands`` is the negative log-likelihood of a set-point, so that chunks weigh no more than
        single ones; ``grasp`` the cross-entropy of a gripper; ``trigger`` that of asking for a
        gait, over the frames that count; ``gait`` that of its type, over the frames that ask.
        """
        hands = self.hands.loss(outputs, targets.hands.flatten(-2)) / self._shape[0]
        grasp = binary_cross_entropy_with_logits(outputs["grasp"], targets.grasp, reduction="none")
        return {
            "hands": mean_over(hands, targets.valid),
            "grasp": mean_over(grasp.mean((-2, -1)), targets.valid),
        } | gait_terms(outputs, targets.gait, targets.valid & targets.gait_counts)

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


class GaitNetwork(nn.Module):
    """Decides about gaits by single frames; see :class:`GaitNetworkConfig`."""

    def __init__(self, config: GaitNetworkConfig, policy: TrillConfig, gaits: int) -> None:
        """Make the layers.

        Args:
            config: of this network.
            policy: of which it is a part.
            gaits: number of choices among the gaits.
        """
        super().__init__()
        # A choice among no gait and the gaits has no trigger.
        self._split = [0 if policy.categorical else 1, gaits]
        self._columns: list[int] = []
        start = 0
        for name, width in policy.inputs.parts.items():
            if name in config.observes:
                self._columns += range(start, start + width)
            start += width
        self._columns += range(start, start + len(policy.inputs.estimated))
        layers: list[nn.Module] = []
        for given, made in pairwise((len(self._columns), *config.layers)):
            layers += [nn.Linear(given, made), nn.ReLU()]
        self.layers = nn.Sequential(*layers, nn.Linear(config.layers[-1], sum(self._split)))

    def forward(self, frames: Tensor) -> Outputs:
        """Return the logits ``gait`` (..., gaits), and ``trigger`` (...) unless it is a choice.

        Args:
            frames: (..., n) observation vectors, and after them what is estimated of the scene.
        """
        trigger, gait = self.layers(frames[..., self._columns]).float().split(self._split, dim=-1)
        return {"gait": gait} | ({"trigger": trigger.squeeze(-1)} if self._split[0] else {})


def gait_terms(outputs: Outputs, gait: Tensor, counts: Tensor) -> Terms:
    """Return the terms ``trigger``, unless the policy has none, and ``gait`` of the loss [nats].

    Args:
        outputs: logits ``trigger`` (...) and ``gait`` (..., gaits).
        gait: (...) the gait to ask for; 0: none.
        counts: (...) whether a frame is learned from.
    """
    if "trigger" not in outputs:
        return {"gait": mean_over(_choice(outputs["gait"], gait), counts)}
    asked = gait > 0
    trigger = binary_cross_entropy_with_logits(
        outputs["trigger"], asked.to(outputs["trigger"].dtype), reduction="none"
    )
    kind = _choice(outputs["gait"], (gait - 1).clamp(min=0))
    return {"trigger": mean_over(trigger, counts), "gait": mean_over(kind, counts & asked)}


def _choice(logits: Tensor, target: Tensor) -> Tensor:
    """Return the cross-entropy (...) of choices (...) under ``logits`` (..., n)."""
    return cross_entropy(logits.flatten(0, -2), target.flatten(), reduction="none").view(
        target.shape
    )
