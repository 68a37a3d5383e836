"""Configuration of TRILL."""

from typing import Literal

from pydantic import Field

from services.policy.configuration import RecurrentSettings


class TrillConfig(RecurrentSettings):
    """TRILL: a mixture for the hands; grasp, gait trigger and type of gait have their own heads."""

    kind: Literal["trill"] = "trill"
    categorical: bool = Field(
        default=False,
        description="one choice among no gait and the gaits, in place of trigger and type: the "
        "paper's ablation",
    )
