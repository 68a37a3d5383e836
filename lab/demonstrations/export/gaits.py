"""Other forms of the gait in the actions than the number in the frame that asks for it.

A request stands in one frame of a hundred or fewer, which is little to learn from.
"""

import numpy as np
from numpy.typing import NDArray

from common.episodes.columns import RATE
from common.schemas import ControlState, Gait

Float32 = NDArray[np.float32]
GAIT_NAMES = tuple(gait.name.lower() for gait in Gait)
"""Name of each number of ``action/locomotion``."""
_TO_BEGIN = RATE
"""A gait that is not begun within so many frames was refused."""


def held_gaits(requests: NDArray[np.int64], states: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the gait of each frame (frames,) from its request until it has been walked.

    Args:
        requests: gait asked for in each frame; 0: none (frames,). One while another is walked is
            left out, since the controller refuses it.
        states: state of the controller in each frame (frames,).
    """
    held, gait, walking, since = np.zeros_like(requests), 0, False, 0
    for frame, (request, state) in enumerate(zip(requests.tolist(), states.tolist(), strict=True)):
        steps = state > ControlState.BALANCE
        if request and not (gait and walking and steps):
            gait, walking, since = request, False, frame
        elif (walking or frame - since > _TO_BEGIN) and not steps:
            gait = 0
        walking = walking or steps
        held[frame] = gait
    return held


def one_hot(gaits: NDArray[np.int64]) -> Float32:
    """Return (frames, gaits) with 1 in the column of each frame's gait; column 0 is no gait."""
    return np.asarray(gaits[:, None] == np.arange(len(GAIT_NAMES)), dtype=np.float32)
