"""Scored tasks done by the synthetic operator, in simulated time."""
