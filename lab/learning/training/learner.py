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
from lab.learning.training.processes import Processes
from lab.learning.training.windows import Batch
from services.policy.networks.policy import Mean, PolicyNetwork, Terms

Metrics = dict[str, float]
"""Terms of the loss by name, their weighted sum ``loss``, and of a step the ``gradient``'s norm."""
_ALONE = Processes()
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


def mixed_precision(config: TrainingConfig, device: torch.device, *, looking: bool) -> bool:
    """Return whether matrix products are taken in 16 bits (bfloat16).

    On a processor without instructions for it they are slower than in 32. With AMX all products are
    taken so, with AVX-512's alone only where pictures are learned from: convolutions then take half
    the time.

    Args:
        config: of training; a precision that it names is taken.
        device: of the network.
        looking: whether the encoders of pictures learn.
    """
    if config.precision != "auto":
        return config.precision == "bfloat16"
    if device.type == "cuda":
        return bool(torch.cuda.is_bf16_supported())
    return _has("_is_amx_tile_supported") or (looking and _has("_is_avx512_bf16_supported"))


def _has(instructions: str) -> bool:
    """Return whether the processor has instructions; no, if torch does not know them."""
    asked = getattr(torch.cpu, instructions, None)
    return asked is not None and bool(asked())


class _TermsOf(nn.Module):
    """From a batch to the terms of the loss, as one module that processes can share."""

    def __init__(self, network: PolicyNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, batch: Batch) -> Terms:
        seen = self.network.look(batch.pictures) if batch.seen is None else batch.seen
        outputs, _ = self.network(batch.observation, seen, at=batch.at)
        return self.network.terms(outputs, batch.targets)


class Learner:
    """A network and its optimiser.

    Attributes:
        network: what learns.
        averaged: the moving average of its weights; the network itself without one.
        optimiser: of the parameters that learn.
    """

    def __init__(
        self,
        network: PolicyNetwork,
        config: TrainingConfig,
        device: torch.device,
        processes: Processes = _ALONE,
    ) -> None:
        """Begin; parameters that need no gradient stay as they are.

        Of several processes the gradients and terms are those of the whole batch. So are the
        statistics of batch normalisations on GPUs; on processors torch does not share them, and
        each process takes those of its part.
        """
        cuda, together = device.type == "cuda", processes.count > 1
        if cuda and together:
            network = nn.SyncBatchNorm.convert_sync_batchnorm(network)
        self.network = network.to(device)
        self._config, self._device, self._processes = config, device, processes
        looking = any(p.requires_grad for p in self.network.encoders.parameters())
        self._mixed = mixed_precision(config, device, looking=looking)
        # All batches are of one size.
        torch.backends.cudnn.benchmark = cuda
        self._terms_of: nn.Module = _TermsOf(self.network)
        if together:
            self._terms_of = nn.parallel.DistributedDataParallel(self._terms_of)
        learning = [p for p in self.network.parameters() if p.requires_grad]
        self.optimiser = torch.optim.AdamW(
            learning, lr=config.rate, weight_decay=config.weight_decay, fused=True
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
            terms = self._of_all(self._terms_of(batch))
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
        # Each process has its part of these, times their number.
        numbers = self._processes.sum(_numbers(terms, loss)) / self._processes.count
        return _metrics(terms, numbers) | {"gradient": float(norm)}

    def validate(self, batches: Iterable[Batch]) -> Metrics:
        """Return the terms of the loss of the averaged network, as means over all batches."""
        self.averaged.eval()
        found: Terms = {}
        with torch.inference_mode(), self._precision():
            for batch in batches:
                for name, term in _TermsOf(self.averaged)(batch).items():
                    so_far = found.get(name, Mean(torch.zeros(()), torch.zeros(())))
                    found[name] = Mean(so_far.total + term.total, so_far.count + term.count)
            return _metrics(found, _numbers(found, self.averaged.loss(found)))

    def _of_all(self, terms: Terms) -> Terms:
        """Return terms whose gradients, averaged over the processes, are the whole batch's."""
        processes = self._processes
        counts = processes.sum(torch.stack([term.count for term in terms.values()]))
        return {
            name: Mean(processes.count * term.total, count)
            for (name, term), count in zip(terms.items(), counts, strict=True)
        }

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


def _numbers(terms: Terms, loss: Tensor) -> Tensor:
    return torch.stack([*(term.value.detach() for term in terms.values()), loss.detach()])


def _metrics(terms: Terms, numbers: Tensor) -> Metrics:
    # Of a GPU one waits for all of them once.
    return dict(zip((*terms, "loss"), numbers.tolist(), strict=True))
