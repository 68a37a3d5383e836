"""An encoder learns from labelled views where things are."""

import numpy as np
import torch

from lab.learning.training.config import TrainingConfig, ViewsConfig
from lab.learning.training.estimator import estimates, train_estimator
from lab.learning.training.views import Views
from services.policy.configuration import ConvolutionConfig, InputConfig
from services.policy.kinds import network
from services.policy.processor.statistics import Statistics
from tests.lab.learning.training.support import blind

POLICY = blind(
    inputs=InputConfig(
        picture_size=(24, 18), joint_state=False, estimated=("ball.x", "ball.y", "ball.z")
    ),
    encoder=ConvolutionConfig(channels=(6, 12), strides=(1, 1), key_points=4, features=8),
)


def views(count: int, seed: int) -> Views:
    """Draw a bright square before a dim mess; x and y are its place, z its disparity."""
    rng = np.random.default_rng(seed)
    pictures = rng.integers(0, 60, size=(count, 2, 18, 24, 3), dtype=np.uint8)
    at = rng.integers((2, 2, 0), (14, 12, 7), size=(count, 3))
    points = np.empty((count, 2, 1, 2))
    for i, (x, y, z) in enumerate(at):
        for eye, left in enumerate((x, x + z)):
            pictures[i, eye, y : y + 4, left : left + 4] = 230
            points[i, eye, 0] = (2 * (left + 2) / 24 - 1, 2 * (y + 2) / 18 - 1)
    return Views(pictures, at.astype(np.float64), points)


def test_it_finds_a_square_in_views_that_it_has_not_seen() -> None:
    torch.manual_seed(0)
    policy, learned, held_out = network(POLICY), views(400, 0), views(100, 1)
    learned.points[::20] = np.nan  # as behind the camera
    config = TrainingConfig(views=ViewsConfig(steps=150, batch=32))
    statistics = Statistics.of(learned.labels, 1e-3)
    before = {name: tensor.clone() for name, tensor in policy.state_dict().items()}
    train_estimator(policy, learned, statistics, config, torch.device("cpu"))
    found = statistics.restore(estimates(policy, held_out, torch.device("cpu")))
    # In pixels; knowing nothing of a view leaves 3.5, 2.9 and 2.0.
    error = np.sqrt(np.square(found - held_out.labels).mean(axis=0))
    assert np.all(error < [0.6, 0.6, 1.0]), error
    # The rest of the policy has not changed.
    for name, tensor in policy.state_dict().items():
        if not name.startswith(("encoders", "estimator")):
            assert torch.equal(tensor, before[name]), name
