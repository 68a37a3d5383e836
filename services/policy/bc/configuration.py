"""Configuration of BC."""

from typing import Literal

from pydantic import Field

from services.policy.configuration import PolicySettings


class BcConfig(PolicySettings):
    """BC: the current frame decides; hands, grippers and locomotion are regressed as one vector."""

    kind: Literal["bc"] = "bc"
    deterministic: bool = Field(
        default=True, description="one set-point and its squared error; false: a mixture"
    )
