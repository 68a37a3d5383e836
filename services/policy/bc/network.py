"""The network of BC."""

from services.policy.networks.flat import FlatNetwork


class BcNetwork(FlatNetwork):
    """A feed-forward network with a flat output; its configuration has no memory."""
