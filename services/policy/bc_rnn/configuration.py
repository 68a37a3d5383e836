"""Configuration of BC-RNN."""

from typing import Literal

from services.policy.configuration import PolicyConfig


class BcRnnConfig(PolicyConfig):
    """BC-RNN: hands, grippers and locomotion are one vector of one mixture."""

    kind: Literal["bc-rnn"] = "bc-rnn"
