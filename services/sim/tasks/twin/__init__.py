"""Twins of the hardware tasks: noisy state, and the link of the paper's robot."""

from services.sim.config import TYPICAL_NOISE

NOISE = TYPICAL_NOISE
LINK = "paper"
"""Preset of the communication between operator and robot."""
