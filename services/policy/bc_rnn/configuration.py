"""Configuration of BC-RNN."""

from typing import Literal

from services.policy.configuration import RecurrentSettings


class BcRnnConfig(RecurrentSettings):
    """BC-RNN: hands, grippers and locomotion are one vector of one mixture."""

    kind: Literal["bc-rnn"] = "bc-rnn"
