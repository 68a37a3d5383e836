"""The network of BC-RNN."""

from services.policy.networks.flat import FlatNetwork


class BcRnnNetwork(FlatNetwork):
    """A recurrent network with a flat output."""
