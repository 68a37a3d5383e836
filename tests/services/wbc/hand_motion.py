"""A hand reference fed with set-points at 20 Hz."""

from collections.abc import Callable

import numpy as np

from services.wbc.config import HandConfig
from services.wbc.hands import HandReference
from services.wbc.references import PoseReference

from .support import Array

CONFIG = HandConfig()
HOME = np.array([0.3, 0.2, 0.1])
PERIOD = 0.05
DT = 0.005
AHEAD = np.eye(3)
Pose = tuple[Array, Array]


def resting_hand(side: str = "left", config: HandConfig = CONFIG) -> HandReference:
    hand = HandReference(side, config)
    hand.hold(HOME, AHEAD, 0.0)
    return hand


def follow(
    hand: HandReference, pose: Callable[[float], Pose], seconds: float, until: float = np.inf
) -> list[tuple[float, PoseReference]]:
    """References every 5 ms with set-points every 50 ms, the last one before ``until``."""
    track = []
    for k in range(round(seconds / DT)):
        time = k * DT
        if k % round(PERIOD / DT) == 0 and time < until:
            hand.set(*pose(time), time)
        track.append((time, hand.at(time)))
    return track


def at_x(x: float) -> Pose:
    return np.array([x, HOME[1], HOME[2]]), AHEAD


def sine(time: float) -> Pose:
    return at_x(0.3 + 0.1 * np.sin(np.pi * time))
