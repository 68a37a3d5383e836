"""The network that all kinds of policy share: encoders, memory, layers; the kinds add outputs."""

from abc import ABC, abstractmethod
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor, nn

from services.policy.configuration import PolicySettings
from services.policy.networks.continuous import Outputs
from services.policy.networks.encoder import Encoder


class Mean(NamedTuple):
    """A mean over what counts in a batch; those of parts of a batch can be put together.

    Attributes:
        total: scalar, sum of what counts.
        count: scalar, how much that is.
    """

    total: Tensor
    count: Tensor

    @property
    def value(self) -> Tensor:
        """The mean; 0 if nothing counts."""
        return self.total / self.count.clamp(min=1.0)


Terms = dict[str, Mean]
"""Terms of a loss by name, not weighted."""


class TargetBatch(NamedTuple):
    """Targets of a batch; leading axes (...) are usually sequences and their frames.

    Attributes:
        hands: (..., steps, numbers) normalised actions.
        grasp: (..., steps, 2) 1 where a gripper shall close.
        gait: (...) the gait to ask for; 0: none.
        gait_counts: (...) whether the frame's gait trigger is learned from.
        valid: (...) whether the frame is one of the sequence, not padding after its end.
    """

    hands: Tensor
    grasp: Tensor
    gait: Tensor
    gait_counts: Tensor
    valid: Tensor


class DecisionBatch(NamedTuple):
    """What a network decides for a batch; see :class:`services.policy.processor.Decision`.

    Attributes:
        hands: (..., steps, numbers) normalised actions.
        grasp: (..., steps, 2) probability that a gripper shall be closed.
        gait: (..., 7) probability of no gait and of each gait.
    """

    hands: Tensor
    grasp: Tensor
    gait: Tensor


class PolicyNetwork(nn.Module, ABC):
    """Encoders of the cameras, an LSTM unless the policy is reactive, and an MLP.

    If the policy estimates numbers of the scene, these alone pass from the encoders to the rest.

    Attributes:
        config: of the policy.
    """

    def __init__(self, config: PolicySettings) -> None:
        super().__init__()
        self.config = config
        cameras = config.inputs.cameras
        # Each camera has weights of its own, as in the paper.
        self.encoders = nn.ModuleDict({camera: Encoder(config.encoder) for camera in cameras})
        seen = len(cameras) * config.encoder.features
        self.estimator = None
        if estimated := config.inputs.estimated:
            hidden = config.estimator.hidden
            self.estimator = nn.Sequential(
                nn.Linear(seen, hidden), nn.ReLU(), nn.Linear(hidden, len(estimated))
            )
            seen = len(estimated)
        width = config.inputs.width + seen
        self.lstm = None
        if lstm := config.recurrence:
            self.lstm = nn.LSTM(width, lstm.hidden, lstm.layers, batch_first=True)
            width = lstm.hidden
        layers: list[nn.Module] = []
        for given, made in pairwise((width, *config.mlp)):
            layers += [nn.Linear(given, made), nn.ReLU()]
        self.mlp = nn.Sequential(*layers)

    def forward(
        self,
        observation: Tensor,
        seen: Tensor,
        memory: Tensor | None = None,
        at: Tensor | None = None,
    ) -> tuple[Outputs, Tensor]:
        """Return the outputs of b sequences of t frames, and the memory after the last frame.

        Args:
            observation: (b, t, n) observation vectors.
            seen: (b, t, m) what :meth:`look` returns of the pictures, or in training the true
                numbers of the scene in its place.
            memory: (2, layers, b, units) after the frame before; None: at the start, zero.
            at: (k,) frames of which outputs are wanted, for instance a few random ones, since
                the outputs of chunks cost more than the memory; None: all.
        """
        x = frames = torch.cat((observation, seen), dim=-1)
        if memory is None:
            memory = self.zero_memory(len(x))
        if self.lstm is not None:
            x, (hidden, cell) = self.lstm(x, (memory[0], memory[1]))
            memory = torch.stack((hidden, cell))
        if at is not None:
            x, frames = x[:, at], frames[:, at]
        return self.outputs(self.mlp(x)) | self.frame_outputs(frames), memory

    def look(self, pictures: Tensor) -> Tensor:
        """Return what the network sees in pictures, (b, t, m) features.

        These are the normalised numbers of the scene if it estimates them.

        Args:
            pictures: (b, t, cameras, height, width, 3) 8-bit pictures of the policy's cameras.
        """
        views = [
            encoder(pictures[:, :, i].flatten(0, 1)).unflatten(0, pictures.shape[:2])
            for i, encoder in enumerate(self.encoders.values())
        ]
        if not views:
            return pictures.new_zeros(*pictures.shape[:2], 0, dtype=self.mlp[0].weight.dtype)
        features = torch.cat(views, dim=-1)
        return features if self.estimator is None else self.estimator(features)

    def zero_memory(self, batch: int) -> Tensor:
        """Return the memory (2, layers, batch, units) at the start."""
        two, layers, units = self.config.memory_shape
        weight = self.mlp[0].weight
        return torch.zeros(two, layers, batch, units, dtype=weight.dtype, device=weight.device)

    @abstractmethod
    def outputs(self, features: Tensor) -> Outputs:
        """Return the parameters of the distributions for features (b, t, n)."""

    def frame_outputs(self, frames: Tensor) -> Outputs:
        """Return those that depend on single frames (..., n), beside memory and MLP: none.

        A frame is the observation vector and what :meth:`look` returns.
        """
        del frames
        return {}

    @abstractmethod
    def terms(self, outputs: Outputs, targets: TargetBatch) -> Terms:
        """Return the terms of the loss: means over the frames that each one learns from."""

    @abstractmethod
    def decide(self, outputs: Outputs) -> DecisionBatch:
        """Return what the outputs mean."""

    def loss(self, terms: Terms) -> Tensor:
        """Return the sum of the terms, weighted as configured."""
        weights = self.config.loss
        weighted = (getattr(weights, name) * term.value for name, term in terms.items())
        return sum(weighted, torch.zeros(()))


def mean_over(values: Tensor, counts: Tensor) -> Mean:
    """Return the mean of ``values`` (...) where ``counts`` (...)."""
    weight = counts.to(values.dtype)
    return Mean((values * weight).sum(), weight.sum())
