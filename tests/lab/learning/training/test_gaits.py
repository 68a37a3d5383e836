"""The gaits' own network learns when to ask, and for which, from the frames in balance alone."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from common.schemas import ControlState, Gait
from lab.learning.training.config import GaitsConfig, NoiseConfig, TrainingConfig
from lab.learning.training.gaits import train_gaits
from lab.learning.training.train import train
from lab.learning.training.windows import Spread, Windows, observation_spread
from services.policy.checkpoint.folder import load_checkpoint
from services.policy.configuration import InputConfig, LossConfig
from services.policy.kinds import network
from services.policy.processor.processor import Processor
from services.policy.trill.configuration import GaitNetworkConfig
from services.policy.trill.network import TrillNetwork
from tests.lab.learning.training.support import SCENE, blind, dataset, job
from tests.services.policy.made import episode

TOLD = InputConfig(vision="blind", joint_state=False, scene=("goal.x", "goal.y"))
POLICY = blind(
    inputs=TOLD, loss=LossConfig(hazard_frames=8), gait_network=GaitNetworkConfig(layers=(64,))
)


def walk(seed: int) -> dict[str, Any]:
    """Return an episode that steps forward or aside until it is at its goal, and then waits.

    It asks within five frames of balance; at the goal it stands for ten, as a demonstration does
    until its verdict.
    """
    rng = np.random.default_rng(seed)
    ahead, left = 0.2 * rng.integers(0, 3), 0.1 * rng.integers(-2, 3)
    states, gaits, goals = [], [], []
    while ahead > 0.1 or abs(left) > 0.05:
        wait = int(rng.integers(3, 6))
        gait = Gait.FORWARD
        if ahead < 0.1:
            gait = Gait.SIDE_LEFT if left > 0 else Gait.SIDE_RIGHT
        states += [ControlState.BALANCE] * wait + [ControlState.RF_SWING] * 6
        gaits += [Gait.NONE] * (wait - 1) + [gait] + [Gait.NONE] * 6
        goals += [(ahead, left)] * (wait + 6)
        ahead -= 0.2 * (gait is Gait.FORWARD)
        left -= 0.1 * ((gait is Gait.SIDE_LEFT) - (gait is Gait.SIDE_RIGHT))
    states += [ControlState.BALANCE] * 10
    gaits += [Gait.NONE] * 10
    goals += [(ahead, left)] * 10
    return episode(seed, len(states)) | {
        "observation/control_state": np.array(states, dtype=np.int64),
        "action/locomotion": np.array(gaits, dtype=np.int64),
        "scene": np.array(goals) + rng.normal(scale=0.01, size=2),
        "intervention": np.zeros(len(states), dtype=np.bool_),
    }


def windows(processor: Processor, episodes: list[dict[str, Any]]) -> Windows:
    frames = sum(len(e["action/locomotion"]) for e in episodes)
    blank = np.empty((frames, 0, 1, 1, 3), dtype=np.uint8)
    return Windows(processor, episodes, blank, TrainingConfig())


def test_it_asks_where_a_gait_is_missing_and_waits_at_the_goal() -> None:
    learned, held_out = [walk(seed) for seed in range(60)], [walk(seed) for seed in range(60, 80)]
    processor = Processor.fit(POLICY, learned)
    torch.manual_seed(0)
    policy = network(POLICY)
    assert isinstance(policy, TrillNetwork)
    assert policy.gait_network is not None
    config = TrainingConfig(gaits=GaitsConfig(steps=300, rate=0.01), noise=NoiseConfig(scene=0.01))
    spreads = observation_spread(processor, config.noise), None
    parts = windows(processor, learned), windows(processor, held_out)
    terms = train_gaits(policy.gait_network, *parts, spreads, config)
    # Nothing known leaves the entropies of one in two, and of one in three.
    assert terms["trigger"] < 0.3
    assert terms["gait"] < 0.3
    for arrays in held_out:
        with torch.inference_mode():
            outputs = policy.gait_network(torch.from_numpy(processor.episode(arrays)))
        gaits, balanced = arrays["action/locomotion"], arrays["observation/control_state"] == 1
        asked = outputs["trigger"].sigmoid().numpy()
        assert np.all(asked[-10:] < 0.5)
        for press in np.flatnonzero(gaits):
            assert asked[press] > 0.5
            assert balanced[press]
            assert int(outputs["gait"][press].argmax()) + 1 == gaits[press]


def test_only_frames_in_balance_are_learned_from() -> None:
    arrays = walk(3)
    made = windows(Processor.fit(POLICY, [arrays]), [arrays])
    frames, gaits = made.in_balance()
    balanced = arrays["observation/control_state"] == ControlState.BALANCE
    assert len(frames) == len(gaits) == balanced.sum() < len(balanced)
    # All frames of balance before a request count as requests: they are fewer than eight.
    assert (gaits == 0).sum() == 10


def test_noise_on_several_vectors_is_joined() -> None:
    one, other = Spread(np.array([1.0]), np.array([0.0])), Spread(np.zeros(2), np.array([0.0, 2.0]))
    joined = Spread.joined(one, other)
    assert joined.constant.tolist() == [1.0, 0.0, 0.0]
    assert joined.white.tolist() == [0.0, 0.0, 2.0]


def test_what_the_gaits_have_learned_stays_while_the_hands_learn(tmp_path: Path) -> None:
    data = dataset(tmp_path / "data")
    told = blind(
        inputs=InputConfig(vision="blind", scene=SCENE), gait_network=GaitNetworkConfig(layers=(8,))
    )
    found = []
    for steps in (1, 4):
        out = tmp_path / str(steps)
        train(job(data, out, told, steps=steps, gaits=GaitsConfig(steps=5, batch=8)))
        found.append(load_checkpoint(out / "last")[0].state_dict())
    same = {name: torch.equal(found[0][name], found[1][name]) for name in found[0]}
    gaits = {name for name in same if name.startswith("gait_network")}
    assert len(gaits) == 4
    assert all(same[name] for name in gaits)
    assert not same["mlp.0.weight"]


def test_features_that_are_learned_for_the_hands_are_no_input_of_the_gaits() -> None:
    with pytest.raises(ValueError, match=r"expected gait_network null, or inputs\.estimated"):
        blind(inputs=InputConfig(), gait_network=GaitNetworkConfig())
