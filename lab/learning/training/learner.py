"""One policy that learns: its network, its optimiser, and a step of both."""

from collections.abc import Iterable
from contextlib import AbstractContextManager, nullcontext
from copy import deepcopy
from math import cos, pi
from typing import Any

import torch
from torch import Tensor, nn

from lab.errors import TrainingError
from lab.learning.training.config import TrainingConfig
from lab.learning.training.windows import Batch
from services.policy.networks.policy import PolicyNetwork

Metrics = dict[str, float]
"""Terms of the loss by name, their weighted sum ``loss``, and of a step the ``gradient``'s norm."""
_BEGIN, _END, _PEAK = 1 / 25, 1e-5, 0.3
"""Of the one-cycle schedule: first and last rate in units of the largest, and when that is."""


def learning_rate(config: TrainingConfig, progress: float) -> float:
    """Return the learning rate after the part ``progress`` (0 to 1) of a training.

    The one-cycle schedule (Smith and Topin, 2017) in cosines, as PyTorch has it: up for three
    tenths, then down.
    """
    if config.schedule == "constant":
        return config.rate
    rising = progress < _PEAK
    part = progress / _PEAK if rising else (progress - _PEAK) / (1.0 - _PEAK)
    low = _BEGIN if rising else _END
    swing = 0.5 * (1.0 - cos(pi * min(part, 1.0)))
    return config.rate * (low + (1.0 - low) * (swing if rising else 1.0 - swing))


def mixed_precision(config: TrainingConfig, device: torch.device) -> bool:
    """Return whether matrix products are taken in 16 bits (bfloat16).

    On a processor without instructions for it they are slower than in 32.
    """
    if config.precision != "auto":
        return config.precision == "bfloat16"
    if device.type == "cuda":
        return bool(torch.cuda.is_bf16_supported())
    amx = getattr(torch.cpu, "_is_amx_tile_supported", None)
    return amx is not None and bool(amx())


class Learner:
    """A network and its optimiser.

    Attributes:
        network: what learns.
        averaged: the moving average of its weights; the network itself without one.
        optimiser: of the parameters that learn.
    """

    def __init__(
        self, network: PolicyNetwork, config: TrainingConfig, device: torch.device
    ) -> None:
        """Begin; parameters that need no gradient stay as they are."""
        self.network = network.to(device)
        self._config, self._device = config, device
        self._mixed = mixed_precision(config, device)
        learning = [p for p in self.network.parameters() if p.requires_grad]
        self.optimiser = torch.optim.AdamW(
            learning, lr=config.rate, weight_decay=config.weight_decay
        )
        self.averaged = deepcopy(self.network) if config.average else self.network

    def learn(self, batch: Batch, progress: float) -> Metrics:
        """Take one step; returns the terms of the loss before it.

        Raises:
            TrainingError: the loss is no number any more.
        """
        self.network.train()
        for group in self.optimiser.param_groups:
            group["lr"] = learning_rate(self._config, progress)
        self.optimiser.zero_grad()
        with self._precision():
            terms = self._terms(self.network, batch.to(self._device))
            loss = self.network.loss(terms)
        loss.backward()
        parameters = self.optimiser.param_groups[0]["params"]
        norm = nn.utils.clip_grad_norm_(parameters, self._config.clip or float("inf"))
        if not bool(torch.isfinite(norm)):
            raise TrainingError(
                f"the gradient is {float(norm)} and the loss {float(loss.detach()):g}: expected "
                "finite numbers; the learning rate is too high, lower training.rate or set "
                "training.clip"
            )
        self.optimiser.step()
        if self._config.average:
            self._follow()
        return _numbers(terms, loss) | {"gradient": float(norm)}

    def validate(self, batches: Iterable[Batch]) -> Metrics:
        """Return the terms of the loss of the averaged network, as means over the batches."""
        self.averaged.eval()
        total: Metrics = {}
        weight = 0
        with torch.inference_mode(), self._precision():
            for batch in batches:
                terms = self._terms(self.averaged, batch.to(self._device))
                count = int(batch.targets.valid.sum())
                for name, value in _numbers(terms, self.averaged.loss(terms)).items():
                    total[name] = total.get(name, 0.0) + count * value
                weight += count
        return {name: value / weight for name, value in total.items()}

    def _terms(self, network: PolicyNetwork, batch: Batch) -> dict[str, Tensor]:
        outputs, _ = network(batch.observation, batch.pictures, at=batch.at, seen=batch.seen)
        return network.terms(outputs, batch.targets)

    def _precision(self) -> AbstractContextManager[Any]:
        mixed = torch.autocast(self._device.type, dtype=torch.bfloat16)
        return mixed if self._mixed else nullcontext()

    def _follow(self) -> None:
        """Move the averaged weights towards the present ones."""
        now = self.network.state_dict()
        with torch.no_grad():
            for name, mean in self.averaged.state_dict().items():
                if mean.is_floating_point():
                    mean.lerp_(now[name], 1.0 - self._config.average)
                else:
                    mean.copy_(now[name])


def _numbers(terms: dict[str, Tensor], loss: Tensor) -> Metrics:
    return {name: float(term.detach()) for name, term in (terms | {"loss": loss}).items()}
