"""A policy learns four short sequences by heart, and replays them step by step."""

from math import log, pi
from typing import Any

import numpy as np
import pytest

from services.policy.configuration import (
    ConvolutionConfig,
    InputConfig,
    LossConfig,
    MemoryConfig,
    MixtureConfig,
)
from services.policy.kinds import network
from services.policy.processor.actions import Command
from services.policy.processor.pictures import Picture
from services.policy.processor.processor import Processor
from tests.services.policy.made import SIZE, episode, small

torch = pytest.importorskip("torch", reason="needs the extra policy")
from services.policy.networks.policy import PolicyNetwork, TargetBatch  # noqa: E402
from services.policy.runtimes.runtime import CachingRuntime  # noqa: E402
from services.policy.runtimes.torch_backend import TorchBackend  # noqa: E402

FRAMES = 12
STEPS = 130
CONFIG = small(
    "trill",
    inputs=InputConfig(picture_size=SIZE),
    encoder=ConvolutionConfig(channels=(6, 12), strides=(2, 1), key_points=6, features=12),
    memory=MemoryConfig(layers=1, hidden=32),
    mlp=(64,),
    mixture=MixtureConfig(modes=2, minimum_std=0.1),
    loss=LossConfig(hands=0.1),
)


def sequences() -> list[dict[str, Any]]:
    """Return four episodes of which the numbers observed are the same: only pictures differ."""
    same = {name: column for name, column in episode(0, FRAMES).items() if name[:3] == "obs"}
    return [episode(seed, FRAMES) | same for seed in range(4)]


def drawn(seed: int) -> Picture:
    """Return pictures (frames, 2, height, width, 3) of a square that moves right, by the seed."""
    pictures = np.zeros((FRAMES, 2, SIZE[1], SIZE[0], 3), dtype=np.uint8)
    for t, (left, right) in enumerate(pictures):
        column = 2 + 4 * seed + t // 4
        left[5:11, column : column + 5] = 255
        right[5:11, column - 1 : column + 4, :2] = 200
    return pictures


def learn(
    policy: PolicyNetwork, processor: Processor, episodes: list[dict[str, Any]], pictures: Any
) -> dict[str, float]:
    """Train on the episodes; return the terms of the loss in the last step."""
    observation = torch.from_numpy(np.stack([processor.episode(arrays) for arrays in episodes]))
    columns = zip(*(processor.targets(arrays) for arrays in episodes), strict=True)
    parts = [torch.from_numpy(np.stack(column)) for column in columns]
    batch = TargetBatch._make([*parts, torch.ones(4, FRAMES, dtype=torch.bool)])
    optimiser = torch.optim.Adam(policy.parameters(), lr=0.015)
    for step in range(STEPS):
        optimiser.param_groups[0]["lr"] = 0.015 * (1.0 - step / STEPS)
        optimiser.zero_grad()
        terms = policy.terms(policy(observation, policy.look(pictures))[0], batch)
        policy.loss(terms).backward()
        torch.nn.utils.clip_grad_norm_(policy.parameters(), 5.0)
        optimiser.step()
    return {name: float(term.value.detach()) for name, term in terms.items()}


def test_four_sequences_are_learned_by_heart_and_replayed() -> None:
    torch.manual_seed(0)
    episodes = sequences()
    pictures = np.stack([drawn(seed) for seed in range(4)])
    policy, processor = network(CONFIG), Processor.fit(CONFIG, episodes)
    terms = learn(policy, processor, episodes, torch.from_numpy(pictures))

    # The least standard deviation is that of all 14 numbers.
    floor = 14 * (log(0.1) + 0.5 * log(2.0 * pi))
    assert floor < terms["hands"] < floor + 0.5
    assert max(terms["grasp"], terms["trigger"], terms["gait"]) < 0.01

    runtime = CachingRuntime(TorchBackend(policy))
    for arrays, views in zip(episodes, pictures, strict=True):
        command = Command(arrays["action/hands"][0], 0.0)
        memory = np.zeros(CONFIG.memory_shape, dtype=np.float32)
        for t in range(FRAMES):
            frame = {name: column[t] for name, column in arrays.items()}
            decision, memory = runtime.run(
                processor.frame(frame, command)[None], views[t : t + 1], memory
            )
            (command,) = processor.commands(decision, command)
            # The differences add up: their errors do as well.
            np.testing.assert_allclose(command.hands, arrays["action/hands"][t], atol=0.01)
            assert decision.gait.argmax() == arrays["action/locomotion"][t]
            np.testing.assert_array_equal(decision.grasp[0] > 0.5, arrays["action/grasp"][t] > 0.5)
