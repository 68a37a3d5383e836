"""Named presets: which network, and how it learns."""

from collections.abc import Mapping
from typing import Any, Final, Literal, NamedTuple

from pydantic import ValidationError

from common.errors import ConfigError, explain
from common.tables import overlaid
from lab.learning.training.config import TrainingConfig
from services.policy.configuration import PolicySettings, Profile
from services.policy.kinds import CONFIGS

Inputs = Literal["pictures", "scene", "blind"]
"""What a policy knows of the scene: its pictures, the simulator's numbers, or nothing."""
SCENES: Final[dict[str, tuple[str, ...]]] = {
    "door/unlock": ("lever_grip", "door_hinge", "door_lever"),
    "door/walk": ("goal",),
    "bench/hammer": ("hammer_grip", "cart_tray"),
    "door/push": (
        *("lever_grip.x", "lever_grip.y", "lever_grip.z"),
        *("goal.x", "goal.y", "goal.sin_yaw", "door_hinge"),
    ),
    "bench/walk": ("goal",),
    "bench/push": (
        *("cart_bar.x", "cart_bar.y", "cart_bar.z", "cart_bar.sin_yaw"),
        *("goal.x", "goal.y"),
    ),
}
"""What is enough to know for a task: objects, joints or single numbers; of other tasks a policy is
told all."""
RecipeName = Literal["paper", "chunks"]
"""``paper`` reproduces; ``chunks`` is this project's own, see :data:`_CHUNKS`."""


class Recipe(NamedTuple):
    """All settings of a training.

    Attributes:
        policy: settings of the policy.
        training: settings of training.
    """

    policy: PolicySettings
    training: TrainingConfig


_CHUNKS: Final[dict[str, Any]] = {
    "policy": {
        "inputs": {"joint_state": False, "gripper_closure": True, "previous_setpoint": True},
        "actions": {"kind": "chunks"},
        # With more Gaussians a network does not learn when a hand begins to move: it gives either
        # case a Gaussian, at the cost of a few nats in a chunk of hundreds of numbers, and follows
        # the likelier one, which rests. With narrower ones it learns the hands' last millimetre.
        "mixture": {"modes": 1, "minimum_std": 0.1},
        "loss": {"hazard_frames": 8},
    },
    "training": {
        "steps": 800,
        "batch": 64,
        "window": 20,
        "loss_frames": 4,
        "rate": 2e-3,
        "schedule": "one-cycle",
        "weight_decay": 1e-4,
        "clip": 5.0,
        "noise": {
            "hand": 0.01,
            "hand_white": 0.003,
            "setpoint": 0.02,
            "scene": 0.008,
            "scene_angle": 0.009,
        },
        "validate_every": 100,
    },
}
"""Chunks of absolute set-points in active time, noise on the inputs, the gait trigger as a hazard,
and, from pictures, an encoder that first learns where things are from rendered views."""
_WALKING_VIEWS: Final[dict[str, Any]] = {"along": 0.05, "across": 0.06, "yaw": 0.1, "steps": 1000}
"""Wherever a gait may end, between the places where those of the demonstrations ended."""
TASKS: Final[dict[str, dict[str, Any]]] = {
    "bench/hammer": {
        # Few frames show that it is time to stop walking; without weight they are not learned.
        "policy": {"loss": {"trigger": 3.0}, "actions": {"execute": 10}},
        "training": {
            "steps": 1200,
            "active": 0.5,
            "standstill": 0.3,
            # The hammer is lifted by 4 cm: with noise of centimetres it is not seen to be.
            "noise": {
                "hand": 0.005,
                "setpoint": 0.01,
                "turn": 0.05,
                "foot": 0.01,
                "scene": 0.004,
            },
            "views": {"steps": 1500},
        },
    },
    # The place to be reached is not in sight of a robot that stands on it; lever and bar are.
    "door/walk": {
        "policy": {"gait_network": {}},
        "training": {"views": {"landmarks": ("lever_grip",), **_WALKING_VIEWS}},
    },
    "bench/walk": {
        "policy": {"gait_network": {}},
        "training": {"views": {"landmarks": ("cart_bar",), **_WALKING_VIEWS}},
    },
    # To pass the frame the robot has to know to centimetres where it is; and where it walks through
    # the scene, the scene of another frame may be in its body.
    "door/push": {
        "policy": {"gait_network": {}},
        "training": {
            "noise": {"estimate": 0.5},
            "views": {"count": 5000, "steps": 2000, "other_scene": 0.0},
        },
    },
    "bench/push": {"training": {"views": {"steps": 1000, "other_scene": 0.1}}},
}
"""What a task needs besides, laid over the recipe ``chunks``."""
_PAPER: Final[dict[Profile, dict[str, Any]]] = {
    "paper": {"training": {"steps": 320_000, "validate_every": 10_000}},
    # Smaller and briefer, and with a rate to match; everything else as in the paper.
    "cpu": {
        "training": {
            "steps": 4000,
            "rate": 1e-3,
            "schedule": "one-cycle",
            "clip": 5.0,
        }
    },
}


def recipe(
    kind: str,
    profile: Profile,
    name: RecipeName,
    inputs: Inputs,
    scene: tuple[str, ...] = (),
    changes: Mapping[str, Any] | None = None,
) -> Recipe:
    """Return the settings of a training.

    Args:
        kind: of the policy.
        profile: size of the network.
        name: of the recipe.
        inputs: what the policy knows of the scene.
        scene: names of the scene's numbers, which it is told or estimates.
        changes: laid over the preset: ``{"policy": {...}, "training": {...}}``.

    Raises:
        ConfigError: a value is wrong.
    """
    base = CONFIGS[kind].profile(profile)
    given: dict[str, Any] = {}
    if inputs == "scene":
        given = {"vision": "blind", "scene": scene}
    elif inputs == "blind":
        given = {"vision": "blind"}
    elif name == "chunks":
        given = {"estimated": scene}
    preset = _CHUNKS if name == "chunks" else _PAPER[profile]
    tables: dict[str, Any] = {"policy": base.model_dump(), "training": {}}
    for layer in (preset, {"policy": {"inputs": given}}, changes or {}):
        tables = overlaid(tables, layer)
    try:
        return Recipe(
            CONFIGS[kind].model_validate(tables.pop("policy")),
            TrainingConfig.model_validate(tables.pop("training")),
        )
    except ValidationError as error:
        raise ConfigError(f"the settings of the training are wrong: {explain(error)}") from error


def task_settings(kind: str, task: str) -> dict[str, Any]:
    """Return the part of :data:`TASKS` for ``task`` that a policy of a kind has.

    A network of their own for the gaits needs outputs of their own.
    """
    own = dict(TASKS.get(task, {}))
    if "policy" in own:
        known = CONFIGS[kind].model_fields
        own["policy"] = {key: part for key, part in own["policy"].items() if key in known}
    return own
