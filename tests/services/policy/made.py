"""Episodes made of numbers, and small policies to learn from them."""

from typing import Any

import numpy as np

from common.robot.kinematics import FORWARD_HAND
from common.robot.rotations import rotate
from common.schemas import ControlState
from services.policy.configuration import (
    ConvolutionConfig,
    InputConfig,
    MemoryConfig,
    PolicySettings,
)
from services.policy.kinds import CONFIGS

SIZE = (24, 18)
"""Width and height of the pictures."""


def small(kind: str, **changes: Any) -> PolicySettings:
    """Return a tiny policy of a kind."""
    given: dict[str, Any] = {
        "inputs": InputConfig(picture_size=SIZE),
        "encoder": ConvolutionConfig(channels=(4, 8), strides=(2, 1), key_points=4, features=8),
        "mlp": (32,),
    }
    if kind != "bc":
        given["memory"] = MemoryConfig(layers=2, hidden=16)
    return CONFIGS[kind](**(given | changes))


def episode(seed: int, frames: int = 30) -> dict[str, Any]:
    """Return the columns of an episode in which both hands move smoothly, and one gait."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 1.0, frames)[:, None]
    hands = []
    for side in (1.0, -1.0):
        position = np.array([0.35, 0.2 * side, 0.1]) + 0.1 * np.sin(
            2.0 * t * rng.uniform(0.5, 1.5, 3)
        ) * np.array([1.0, 0.5, 1.0])
        turns = t * rng.uniform(-0.6, 0.6, 3)
        hands += [position, np.array([rotate(FORWARD_HAND, turn) for turn in turns])]
    locomotion = np.zeros(frames, dtype=np.int64)
    locomotion[frames // 2] = 1 + seed % 6
    state = np.full(frames, int(ControlState.BALANCE), dtype=np.int64)
    state[frames // 2 + 1 : frames // 2 + 6] = ControlState.RF_SWING
    q = rng.normal(scale=0.3, size=(frames, 27))
    return {
        "observation/poses": rng.normal(size=(frames, 28)),
        "observation/control_state": state,
        "observation/joint_sin_cos": np.concatenate((np.sin(q), np.cos(q)), axis=1),
        "observation/joint_velocity": rng.normal(size=(frames, 27)),
        "observation/gripper_closure": rng.uniform(size=(frames, 2)),
        "action/hands": np.concatenate(hands, axis=1),
        "action/grasp": (t > [0.3, 0.6]).astype(np.float64),
        "action/locomotion": locomotion,
        "action/neck": 0.3 * t[:, 0],
        "scene": rng.normal(size=(frames, 2)),
    }
