"""Records every message on the bus into an MCAP log."""
