"""Names policies by what sets them apart, as the rows of tables are called."""

from collections.abc import Mapping
from typing import Any, NamedTuple

KINDS = ("bc", "bc-rnn", "trill")
ABLATIONS = ("monoscopic", "no-joint-state", "deterministic", "categorical")
"""The paper's ablations, as it names them."""


class PolicyName(NamedTuple):
    """What sets a policy apart from the paper's network.

    Attributes:
        kind: ``bc``, ``bc-rnn`` or ``trill``.
        ablations: the paper's, as far as it has them.
        scene: how it knows the scene: empty from its pictures at once, ``estimated scene`` by what
            it has learned to see, ``oracle`` told by a simulator, ``blind`` not at all.
        actions: ``chunks``; empty for the paper's differences.
    """

    kind: str
    ablations: tuple[str, ...] = ()
    scene: str = ""
    actions: str = ""

    def __str__(self) -> str:
        return ", ".join(filter(None, (self.kind, *self.ablations, self.setting)))

    @property
    def setting(self) -> str:
        """What policies have in common that are compared with one another."""
        return ", ".join(filter(None, (self.scene, self.actions)))


def policy_name(policy: Mapping[str, Any]) -> PolicyName:
    """Return the name of a policy, in text for instance ``trill, monoscopic``.

    Args:
        policy: configuration of the policy, as a checkpoint's manifest has it.
    """
    inputs = policy.get("inputs", {})
    vision = inputs.get("vision", "stereo")
    kind = policy.get("kind", "policy")
    chunks = policy.get("actions", {}).get("kind") == "chunks"
    # Policies of chunks do without joint positions anyway, but not without what these tell.
    unfelt = inputs.get("joint_state") is False
    if chunks:
        unfelt = unfelt and inputs.get("body_poses") is False
    found = {
        "monoscopic": vision == "monoscopic",
        "no-joint-state": unfelt,
        # The reactive baseline is regressed in the paper, too.
        "deterministic": bool(policy.get("deterministic")) and kind != "bc",
        "categorical": bool(policy.get("categorical")),
    }
    scene = "blind" if vision == "blind" else ""
    if inputs.get("scene"):
        scene = "oracle"
    elif inputs.get("estimated"):
        scene = "estimated scene"
    ablations = tuple(name for name in ABLATIONS if found[name])
    return PolicyName(kind, ablations, scene, "chunks" if chunks else "")
