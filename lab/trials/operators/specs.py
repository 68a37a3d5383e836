"""Describes the operator of a trial: everything about it that decides how the trial goes."""

from typing import Literal

from pydantic import BaseModel, ConfigDict

from services.teleop.synthetic.traits import OperatorTraits


class SyntheticSpec(BaseModel):
    """The synthetic operator, a model of a person.

    Attributes:
        kind: tells the kinds of operator apart.
        traits: its parameters.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    kind: Literal["synthetic"] = "synthetic"
    traits: OperatorTraits = OperatorTraits()

    def __str__(self) -> str:
        return f"{self.kind}, {self.traits.name}"


OperatorSpec = SyntheticSpec
"""The operator of a trial; ``kind`` tells which."""
