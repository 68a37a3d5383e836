"""Configuration of BC."""

from typing import Literal

from services.policy.configuration import PolicyConfig


class BcConfig(PolicyConfig):
    """BC: the current frame decides; hands, grippers and locomotion are regressed as one vector."""

    kind: Literal["bc"] = "bc"
    memory: None = None
    deterministic: bool = True
