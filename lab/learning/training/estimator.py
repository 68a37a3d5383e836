"""The encoders of a policy learn to estimate where things are, from rendered views with labels.

Without this a policy hardly learns from a hundred demonstrations where things are, since their
pictures differ by centimetres. The recipe: a Huber loss on the normalised labels, and a second
loss that ties one key point of each encoder to each object (cross-entropy of its heat map against a
Gaussian around the object), with jitter of brightness and contrast.
"""

from collections.abc import Callable

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.functional import smooth_l1_loss

from lab.learning.training.config import TrainingConfig
from lab.learning.training.learner import learning_rate
from lab.learning.training.views import Views
from services.policy.networks.encoder import Encoder
from services.policy.networks.policy import PolicyNetwork
from services.policy.processor.statistics import Statistics

SPREAD = 1.0
"""Standard deviation of the Gaussian around an object, in cells of the feature map."""


def estimating_parts(network: PolicyNetwork) -> nn.ModuleDict:
    """Return the parts of a network that estimate the scene; the others do not."""
    assert network.estimator is not None
    return nn.ModuleDict({"encoders": network.encoders, "estimator": network.estimator})


def train_estimator(
    network: PolicyNetwork,
    views: Views,
    statistics: Statistics,
    config: TrainingConfig,
    device: torch.device,
    report: Callable[[int, float], None] = lambda _step, _loss: None,
) -> None:
    """Train the parts of a network that estimate the scene, in place.

    Args:
        network: of a policy that estimates numbers of the scene.
        views: to learn from.
        statistics: of these numbers, by which they are normalised.
        config: of training.
        device: on which to train.
        report: called after each step with its number and its loss.
    """
    settings = config.views
    parts = estimating_parts(network).to(device).train()
    optimiser = torch.optim.AdamW(parts.parameters(), lr=settings.rate, weight_decay=1e-4)
    schedule = config.model_copy(update={"rate": settings.rate, "schedule": "one-cycle"})
    labels = torch.from_numpy(statistics.normalise(views.labels))
    points = torch.from_numpy(views.points.astype(np.float32))
    for step in range(settings.steps):
        rng = np.random.default_rng((config.seed, step))
        chosen = torch.from_numpy(rng.integers(len(labels), size=settings.batch))
        pictures = _jittered(torch.from_numpy(views.pictures)[chosen], rng, config).to(device)
        for group in optimiser.param_groups:
            group["lr"] = learning_rate(schedule, step / settings.steps)
        optimiser.zero_grad()
        found, heats = _look(network, pictures)
        loss = smooth_l1_loss(found, labels[chosen].to(device))
        if settings.heat:
            loss = loss + settings.heat * _heat_loss(heats, points[chosen].to(device))
        loss.backward()
        optimiser.step()
        report(step, float(loss.detach()))
    parts.eval()


def estimates(
    network: PolicyNetwork, views: Views, device: torch.device, batch: int = 64
) -> NDArray[np.float32]:
    """Return the normalised estimates (n, m) of views, as in service."""
    network.to(device).eval()
    found = []
    with torch.inference_mode():
        for pictures in torch.from_numpy(views.pictures).split(batch):
            found.append(network.look(pictures[:, None].to(device))[:, 0].cpu().numpy())
    return np.concatenate(found)


def _look(network: PolicyNetwork, pictures: Tensor) -> tuple[Tensor, list[Tensor]]:
    """Return the estimates (n, m), and of each camera its heat maps (n, points, h, w) in logs."""
    features, heats = [], []
    for i, encoder in enumerate(network.encoders.values()):
        assert isinstance(encoder, Encoder)
        maps = encoder.maps(pictures[:, i])
        heats.append(encoder.points.heat(maps))
        features.append(encoder.features(encoder.points.of(heats[-1])))
    assert network.estimator is not None
    return network.estimator(torch.cat(features, dim=-1)), heats


def _heat_loss(heats: list[Tensor], points: Tensor) -> Tensor:
    """Return the cross-entropy of key points against Gaussians around the objects in sight."""
    total = points.new_zeros(())
    for i, heat in enumerate(heats):
        height, width = heat.shape[2:]
        seen = points[:, i, : heat.shape[1]]
        inside = (seen.abs() <= 1.0).all(dim=-1)
        if not bool(inside.any()):
            continue
        size = torch.tensor((width, height), device=heat.device)
        # Where an object is behind the camera: NaN times no gradient is NaN.
        at = (seen.nan_to_num() + 1.0) * size / 2.0 - 0.5
        x = torch.arange(width, device=heat.device) - at[..., 0, None]
        y = torch.arange(height, device=heat.device) - at[..., 1, None]
        squares = x.square()[..., None, :] + y.square()[..., :, None]
        wanted = torch.softmax((-0.5 / SPREAD**2 * squares).flatten(2), dim=2)
        crossed = -(wanted * heat[:, : seen.shape[1]].flatten(2)).sum(2)
        total = total + crossed[inside].mean()
    return total / len(heats)


def _jittered(pictures: Tensor, rng: np.random.Generator, config: TrainingConfig) -> Tensor:
    """Return pictures (n, cameras, h, w, 3) as numbers from 0 to 255, darker or brighter."""
    views = config.views
    shape = (len(pictures), 1, 1, 1, 1)
    gain = torch.from_numpy(rng.normal(1.0, views.contrast, shape).astype(np.float32))
    shift = torch.from_numpy(rng.normal(0.0, 255.0 * views.brightness, shape).astype(np.float32))
    whole = pictures.float()
    mean = whole.mean(dim=(1, 2, 3, 4), keepdim=True)
    return ((whole - mean) * gain + mean + shift).clamp(0.0, 255.0)
