"""The gaits' own network learns first, from the frames in which a gait could be asked for.

These are few, and so are the requests beside the set-points of the hands.
"""

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray

from lab.learning.training.config import TrainingConfig
from lab.learning.training.learner import Metrics, learning_rate
from lab.learning.training.windows import Spread, Windows
from services.policy.networks.policy import Terms
from services.policy.trill.network import GaitNetwork, gait_terms


def train_gaits(
    gaits: GaitNetwork,
    learned: Windows,
    held_out: Windows,
    spreads: tuple[Spread, Spread | None],
    config: TrainingConfig,
    report: Callable[[int, float], None] = lambda _step, _loss: None,
) -> Metrics:
    """Train the gaits' own network, in place; return its terms of the loss on held-out episodes.

    Args:
        gaits: the network.
        learned: episodes to learn from.
        held_out: episodes to validate on.
        spreads: noise on observations, and on numbers of the scene in place of an estimate.
        config: of training.
        report: called after each step with its number and its loss.
    """
    settings = config.gaits
    optimiser = torch.optim.AdamW(
        gaits.parameters(), lr=settings.rate, weight_decay=settings.weight_decay
    )
    schedule = config.model_copy(update={"rate": settings.rate, "schedule": "one-cycle"})
    frames, wanted = learned.in_balance()
    spread = Spread.joined(*(spread for spread in spreads if spread is not None))
    for step in range(settings.steps):
        rng = np.random.default_rng((config.seed, step))
        chosen = rng.integers(len(frames), size=settings.batch)
        seen = frames[chosen] + spread.draw(rng, settings.batch, 1)[:, 0]
        for group in optimiser.param_groups:
            group["lr"] = learning_rate(schedule, step / settings.steps)
        optimiser.zero_grad()
        loss = sum(term.value for term in _terms(gaits, seen, wanted[chosen]).values())
        loss.backward()
        optimiser.step()
        report(step + 1, float(loss.detach()))
    with torch.inference_mode():
        terms = _terms(gaits, *held_out.in_balance())
    return {name: float(term.value) for name, term in terms.items()}


def _terms(gaits: GaitNetwork, frames: NDArray[np.float32], wanted: NDArray[np.int64]) -> Terms:
    """Return the terms of the loss of ``frames`` (n, width), all of which count."""
    device = next(gaits.parameters()).device
    asked = torch.from_numpy(wanted).to(device)
    every = torch.ones_like(asked, dtype=torch.bool)
    return gait_terms(gaits(torch.from_numpy(frames).to(device)), asked, every)
