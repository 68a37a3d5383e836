"""Small data sets from which a policy can learn within seconds."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from common.episodes.columns import COLUMNS, Rows
from common.episodes.episode_file import Operator
from lab.learning.training.config import TrainingConfig
from lab.learning.training.demonstrations import Demonstration
from lab.learning.training.recipes import Recipe
from lab.learning.training.train import Job
from services.policy.configuration import InputConfig, MemoryConfig, MixtureConfig, PolicySettings
from services.policy.processor.pictures import Picture
from tests.lab.demonstrations.export.support import make
from tests.services.policy.made import episode, small

TASK = "door/unlock"
FRAMES = 16
PICTURE = (48, 36)
"""Width and height of the pictures of the data set."""
SCENE = ("lever_grip.x", "lever_grip.y", "door_hinge")


def rows(seed: int) -> Rows:
    """Return smooth motions; the robot stands where the seed says, and the door opens."""
    arrays, found = episode(seed, FRAMES), Rows()
    rng = np.random.default_rng(seed)
    at = np.array([0.2, 0.05, 0.8]) + rng.normal(scale=0.03, size=3)
    for frame in range(FRAMES):
        door = np.array([0.05 * frame / FRAMES, 0.0, 0.0])
        truth: dict[str, Any] = {
            "truth/base_position": at,
            "truth/base_quaternion": np.eye(4)[0],
            "truth/joint_position": np.zeros(27),
            "truth/gripper_closure": np.zeros(2),
            "truth/scene_qpos": door,
        }
        for column in COLUMNS:
            value: Any = np.zeros(len(column.names)) if column.names else 0
            if column.path in arrays:
                value = arrays[column.path][frame]
            found.rows[column.path].append(truth.get(column.path, value))
    return found


def dataset(
    root: Path,
    count: int = 5,
    *,
    pictures: bool = False,
    operator: Operator = "synthetic",
    helped: Sequence[tuple[int, int]] = (),
) -> Path:
    """A data set of successes; in the frames from a to b of each (a, b) an operator intervened."""
    rows_of = {seed: rows(seed) for seed in range(count)}
    for made in rows_of.values():
        for first, end in helped:
            made.rows["intervention"][first:end] = [True] * (end - first)
    return make(
        root,
        ("success",) * count,
        task=TASK,
        size=PICTURE if pictures else None,
        rows_of=rows_of,
        operator=operator,
    )


def blind(**changes: Any) -> PolicySettings:
    """Return a policy that sees nothing, and is told apart by where its hands are."""
    given: dict[str, Any] = {
        "inputs": InputConfig(vision="blind", joint_state=False),
        "memory": MemoryConfig(layers=1, hidden=32),
        "mlp": (64,),
        "mixture": MixtureConfig(modes=2, minimum_std=0.1),
    }
    return small("trill", **(given | changes))


def job(data: Path, out: Path, policy: PolicySettings | None = None, **changes: Any) -> Job:
    given: dict[str, Any] = {
        "steps": 6,
        "batch": 4,
        "window": 8,
        "rate": 0.01,
        "schedule": "one-cycle",
        "clip": 5.0,
        "validate_every": 3,
        "held_out": 0.2,
        "precision": "float32",
    }
    recipe = Recipe(policy or blind(), TrainingConfig(**(given | changes)))
    return Job(TASK, (data,), out, recipe, torch.device("cpu"))


def not_asked(_shown: Demonstration) -> Iterator[list[Picture]]:
    """Stand in for what renders the pictures of demonstrations that have some."""
    raise AssertionError("the demonstrations have pictures")
