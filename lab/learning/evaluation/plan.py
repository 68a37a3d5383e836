"""Chooses the trials by which a checkpoint is evaluated."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from common.errors import ConfigError
from lab.learning.evaluation.names import policy_name
from lab.trials.operators.specs import PolicySpec, StillPictures
from services.policy.checkpoint.manifest import Description
from services.policy.serving.config import PolicyConfig

CONSTANT = "constant, mean action"
"""Row of the policy that answers with the mean action."""


def policy_spec(
    checkpoint: Path, description: Description, serving: Mapping[str, Any], label: str = ""
) -> PolicySpec:
    """Return the operator that runs a checkpoint.

    Args:
        checkpoint: its folder.
        description: of the checkpoint.
        serving: fields of the serving configuration, by name.
        label: name of its row; empty: what sets it apart.

    Raises:
        ConfigError: a field is unknown or its value is wrong.
    """
    manifest = description.manifest
    # The whole configuration decides a trial, whatever this version's defaults are.
    config = _serving(checkpoint, serving)
    about = {
        "policy": manifest.policy.model_dump(mode="json"),
        "origin": manifest.origin.model_dump(mode="json"),
    }
    changed = ", ".join(f"{name}={value}" for name, value in serving.items())
    name = ", ".join(filter(None, [str(policy_name(about["policy"])), changed]))
    return PolicySpec(
        checkpoint=str(checkpoint),
        digest=description.digest,
        serving=config.model_dump(mode="json", exclude={"checkpoint", "stay"}),
        label=label or name,
        about=about,
    )


def blind(spec: PolicySpec, pictures: StillPictures) -> PolicySpec:
    """Return the policy that sees the same pictures at every moment."""
    return spec.model_copy(update={"pictures": pictures, "label": f"{spec.label}, mean pictures"})


def constant(spec: PolicySpec) -> PolicySpec:
    """Return the policy that answers with the mean action of its data set."""
    return spec.model_copy(update={"constant": True, "label": CONSTANT})


def serving_options(words: Iterable[str]) -> dict[str, Any]:
    """Read options ``NAME=VALUE`` of the serving configuration; ``trigger.level=0.5`` is nested.

    Raises:
        ConfigError: one has no ``=``.
    """
    table: dict[str, Any] = {}
    for word in words:
        name, equals, value = word.partition("=")
        if not equals or not name:
            raise ConfigError(f"--serve: expected NAME=VALUE, for instance execute=3, got {word!r}")
        *groups, last = name.split(".")
        place = table
        for group in groups:
            place = place.setdefault(group, {})
            if not isinstance(place, dict):
                raise ConfigError(f"--serve: {group} is given as a value and as a group")
        place[last] = None if value == "null" else value
    return table


def _serving(checkpoint: Path, serving: Mapping[str, Any]) -> PolicyConfig:
    from common.tables import validated

    return validated(PolicyConfig, {**serving, "checkpoint": checkpoint}, what="--serve")
