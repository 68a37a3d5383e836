"""The output of continuous actions: a Gaussian mixture, or one value with its squared error."""

from math import log, pi

import torch
from torch import Tensor, nn

from services.policy.configuration import MixtureConfig

Outputs = dict[str, Tensor]
"""Parameters of the distributions that a network puts out, by name."""


def mixture_log_likelihood(outputs: Outputs, value: Tensor) -> Tensor:
    """Return the log-likelihood (...) of ``value`` (..., n) under a mixture of Gaussians.

    Args:
        outputs: ``mode`` (..., m) unnormalised log-weights, ``mean`` and ``std`` (..., m, n); the
            numbers of a mode are independent.
        value: what was observed.
    """
    z = (value.unsqueeze(-2) - outputs["mean"]) / outputs["std"]
    gauss = -0.5 * z.square().sum(-1) - outputs["std"].log().sum(-1)
    mixed = torch.logsumexp(torch.log_softmax(outputs["mode"], -1) + gauss, -1)
    return mixed - 0.5 * log(2.0 * pi) * value.shape[-1]


class MixtureOutput(nn.Module):
    """Mixture density output (Bishop, 1994) of n numbers."""

    def __init__(self, given: int, numbers: int, config: MixtureConfig) -> None:
        super().__init__()
        self._modes, self._numbers = config.modes, numbers
        self._minimum_std = config.minimum_std
        self.mode = nn.Linear(given, config.modes)
        self.mean = nn.Linear(given, config.modes * numbers)
        self.std = nn.Linear(given, config.modes * numbers)

    def forward(self, features: Tensor) -> Outputs:
        """Return ``mode`` (..., m), ``mean`` and ``std`` (..., m, n) for features (..., given)."""
        shape = (*features.shape[:-1], self._modes, self._numbers)
        # Less 1: a standard deviation of about a third of the targets' at the start.
        std = nn.functional.softplus(self.std(features).float() - 1.0) + self._minimum_std
        return {
            "mode": self.mode(features).float(),
            "mean": self.mean(features).float().view(shape),
            "std": std.view(shape),
        }

    def loss(self, outputs: Outputs, value: Tensor) -> Tensor:
        """Return the negative log-likelihood (...) of ``value`` (..., n)."""
        return -mixture_log_likelihood(outputs, value)

    def decide(self, outputs: Outputs) -> Tensor:
        """Return the mean (..., n) of the likeliest mode."""
        mode = outputs["mode"].argmax(-1)[..., None, None]
        index = mode.expand(*mode.shape[:-1], self._numbers)
        return outputs["mean"].gather(-2, index).squeeze(-2)


class RegressionOutput(nn.Module):
    """One value of n numbers: the deterministic ablation."""

    def __init__(self, given: int, numbers: int) -> None:
        super().__init__()
        self.mean = nn.Linear(given, numbers)

    def forward(self, features: Tensor) -> Outputs:
        """Return ``mean`` (..., n) for features (..., given)."""
        return {"mean": self.mean(features).float()}

    def loss(self, outputs: Outputs, value: Tensor) -> Tensor:
        """Return half the squared error (...) of ``value`` (..., n)."""
        return 0.5 * (value - outputs["mean"]).square().sum(-1)

    def decide(self, outputs: Outputs) -> Tensor:
        """Return the value (..., n)."""
        return outputs["mean"]


def continuous_output(
    given: int, numbers: int, mixture: MixtureConfig, *, deterministic: bool
) -> MixtureOutput | RegressionOutput:
    """Return the output that a configuration chooses."""
    if deterministic:
        return RegressionOutput(given, numbers)
    return MixtureOutput(given, numbers, mixture)
