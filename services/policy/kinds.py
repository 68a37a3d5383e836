"""THE table of the kinds of policy: their configuration and their network."""

from importlib import import_module
from typing import TYPE_CHECKING, Annotated, Final

from pydantic import Field

from services.policy.bc.configuration import BcConfig
from services.policy.bc_rnn.configuration import BcRnnConfig
from services.policy.configuration import PolicySettings
from services.policy.trill.configuration import TrillConfig

if TYPE_CHECKING:
    from services.policy.networks.policy import PolicyNetwork

AnyConfig = Annotated[TrillConfig | BcRnnConfig | BcConfig, Field(discriminator="kind")]
"""Configuration of a policy of any kind; ``kind`` tells which."""

CONFIGS: Final[dict[str, type[PolicySettings]]] = {
    "trill": TrillConfig,
    "bc-rnn": BcRnnConfig,
    "bc": BcConfig,
}
"""Configurations by kind."""

_NETWORKS: Final[dict[type[PolicySettings], str]] = {
    TrillConfig: "services.policy.trill.network:TrillNetwork",
    BcRnnConfig: "services.policy.bc_rnn.network:BcRnnNetwork",
    BcConfig: "services.policy.bc.network:BcNetwork",
}


def network(config: PolicySettings) -> "PolicyNetwork":
    """Return a new network of a policy's kind, with random weights from torch's generator."""
    # The table has to be readable where torch is not installed.
    module, _, name = _NETWORKS[type(config)].partition(":")
    made: PolicyNetwork = getattr(import_module(module), name)(config)
    return made
