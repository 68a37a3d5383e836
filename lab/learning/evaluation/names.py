"""Names policies by what sets them apart, as the rows of tables are called."""

from collections.abc import Mapping
from typing import Any

ABLATIONS = ("monoscopic", "no-joint-state", "deterministic", "categorical")
"""The paper's ablations, as it names them."""


def policy_name(policy: Mapping[str, Any]) -> str:
    """Return the name of a policy's row, for instance ``trill, monoscopic``.

    The kind, what sets it apart from the paper's network, ``oracle`` if a simulator tells it the
    scene, and ``estimated scene`` if it has learned to see what a simulator would tell.

    Args:
        policy: configuration of the policy, as a checkpoint's manifest has it.
    """
    inputs, words = policy.get("inputs", {}), []
    if inputs.get("scene"):
        words.append("oracle")
    elif inputs.get("vision") != "stereo":
        words.append(inputs.get("vision", "stereo"))
    if inputs.get("joint_state") is False:
        words.append("no-joint-state")
    if inputs.get("estimated"):
        words.append("estimated scene")
    words += [name for name in ("deterministic", "categorical") if policy.get(name)]
    if policy.get("actions", {}).get("kind") == "chunks":
        words.append("chunks")
    return ", ".join([str(policy.get("kind", "policy")), *words])
