"""What a network is to learn of each frame of an episode."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.schemas import ControlState, Gait

GAITS = len(Gait)
"""No gait and six gaits, numbered as :class:`~common.schemas.Gait`."""


class Targets(NamedTuple):
    """Targets of T frames.

    Attributes:
        hands: (T, steps, numbers) float32, normalised actions of hands and neck.
        grasp: (T, steps, 2) float32, 1 where a gripper shall close.
        gait: (T,) int64, the gait to ask for; 0: none.
        gait_counts: (T,) bool, whether the frame's gait trigger is learned from.
    """

    hands: NDArray[np.float32]
    grasp: NDArray[np.float32]
    gait: NDArray[np.int64]
    gait_counts: NDArray[np.bool_]


def gait_targets(
    locomotion: NDArray[np.int64], control_state: NDArray[np.int64], hazard_frames: int
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return ``gait`` and ``gait_counts`` of T frames.

    A request is one frame in dozens, and a person presses a little sooner or later. As a hazard, a
    request counts in the frames before it too, as long as the robot is in balance; frames out of
    balance, in which a request would be refused, teach nothing.

    Args:
        locomotion: (T,) the column ``action/locomotion``.
        control_state: (T,) the column ``observation/control_state``.
        hazard_frames: how many frames before a request count as requests; 0: requests and all
            frames as they are.
    """
    if hazard_frames == 0:
        return locomotion, np.ones(len(locomotion), dtype=np.bool_)
    balanced = control_state == ControlState.BALANCE
    gait = locomotion.copy()
    for frame in np.flatnonzero(locomotion).tolist():
        for before in range(frame - 1, max(frame - hazard_frames, 0) - 1, -1):
            if not balanced[before] or locomotion[before]:
                break
            gait[before] = locomotion[frame]
    return gait, balanced | (locomotion > 0)
