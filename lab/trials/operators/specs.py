"""Describes the operator of a trial: everything about it that decides how the trial goes."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from services.teleop.synthetic.take_over import TakeOver
from services.teleop.synthetic.traits import OperatorTraits


class _Spec(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class SyntheticSpec(_Spec):
    """The synthetic operator, a model of a person.

    Attributes:
        kind: tells the kinds of operator apart.
        traits: its parameters.
    """

    kind: Literal["synthetic"] = "synthetic"
    traits: OperatorTraits = OperatorTraits()

    def __str__(self) -> str:
        return f"{self.kind}, {self.traits.name}"


class StillPictures(_Spec):
    """The same two pictures at every moment, in place of what the cameras see.

    Attributes:
        file: a picture file with the left picture beside the right one.
        sha256: digest of its content.
    """

    file: str
    sha256: str


class PolicySpec(_Spec):
    """A policy.

    Attributes:
        kind: tells the kinds of operator apart.
        checkpoint: folder of its checkpoint.
        digest: SHA-256 of the checkpoint's manifest, which has those of the other files.
        serving: fields of :class:`services.policy.serving.config.PolicyConfig`, by name, that
            differ from the defaults.
        pictures: what it is shown; None: what the cameras see.
        constant: whether it answers with the mean action of its data set in place of the network's.
        label: name of its row in tables.
        about: the manifest's description of the policy and where it comes from, for tables.
    """

    kind: Literal["policy"] = "policy"
    checkpoint: str
    digest: str
    serving: Mapping[str, Any] = Field(default_factory=dict)
    pictures: StillPictures | None = None
    constant: bool = False
    label: str = ""
    about: Mapping[str, Any] = Field(default_factory=dict)

    def __str__(self) -> str:
        return f"{self.kind}, {self.label or self.digest[:12]}"


class HelpedSpec(_Spec):
    """A policy, and the synthetic operator that takes over when the policy does not get on.

    Attributes:
        kind: tells the kinds of operator apart.
        policy: it operates the robot first.
        traits: parameters of the synthetic operator.
        take_over: when that one takes over.
    """

    kind: Literal["helped"] = "helped"
    policy: PolicySpec
    traits: OperatorTraits = OperatorTraits()
    take_over: TakeOver = TakeOver()

    def __str__(self) -> str:
        return f"{self.policy}, helped by {self.traits.name}"


OperatorSpec = Annotated[SyntheticSpec | PolicySpec | HelpedSpec, Field(discriminator="kind")]
"""The operator of a trial; ``kind`` tells which."""
NOT_DECIDING: Mapping[str, Any] = {
    "checkpoint": True,
    "label": True,
    "about": True,
    "pictures": {"file"},
    "policy": {"checkpoint": True, "label": True, "about": True, "pictures": {"file"}},
}
"""Fields that say where an operator's files are and how to call it; digests say what it is."""
