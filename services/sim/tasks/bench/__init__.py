"""The Workbench environment: walk to the trolley, load it with a hammer, push it away."""

import math

from services.sim.scenes.bench import PUSH_GOAL, PUSH_LANE
from services.sim.scenes.cart import BAR_OFFSET, CART_JOINTS

JOINTS = CART_JOINTS
REACH = 0.42
"""From the torso to the push bar when the fists are to lie on it [m]."""
PUSH_START = (REACH + BAR_OFFSET, PUSH_LANE)
"""Where the trolley's centre is before it is pushed (x, y) [m]."""


def cart_at(x: float, y: float, yaw: float) -> dict[str, tuple[float, ...]]:
    """``qpos`` of the trolley's joints [m, rad]."""
    return {name: (value,) for name, value in zip(CART_JOINTS, (x, y, yaw), strict=True)}


def turn(angle: float) -> float:
    """The same angle within ±pi [rad]."""
    return math.remainder(angle, math.tau)


__all__ = ["JOINTS", "PUSH_GOAL", "PUSH_LANE", "PUSH_START", "REACH", "cart_at", "turn"]
