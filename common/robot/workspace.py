"""The workspace of the hands: the box in which the controller follows hand set-points."""

from typing import Final

import numpy as np

from common.schemas.arrays import Float64Array as Array

X_RANGE: Final = (0.15, 0.56)
Y_RANGE: Final = (-0.10, 0.45)
Z_RANGE: Final = (-0.15, 0.40)
"""Ranges of the left hand in the body frame [m]; the right hand's y is mirrored.

The box resembles that of the public TRILL configuration. Its x begins at 0.15 m, so that a hand can
be drawn back to the torso, and ends at 0.56 m (0.50 m there), which is beyond an arm's reach on
purpose: in a push the position error makes the force. Its z begins at -0.15 m (-0.11 m there) and
ends at 0.40 m: higher up, close to the chest, the upper arms press against it and topple the robot.
"""

WORKSPACE: Final[dict[str, tuple[Array, Array]]] = {
    "left": (
        np.array((X_RANGE[0], Y_RANGE[0], Z_RANGE[0])),
        np.array((X_RANGE[1], Y_RANGE[1], Z_RANGE[1])),
    ),
    "right": (
        np.array((X_RANGE[0], -Y_RANGE[1], Z_RANGE[0])),
        np.array((X_RANGE[1], -Y_RANGE[0], Z_RANGE[1])),
    ),
}
"""Lowest and highest corner (3,) of each hand's box in the body frame [m]."""


def clamp_to_workspace(side: str, position: Array) -> Array:
    """Return the point of the workspace that is nearest to ``position``.

    Args:
        side: ``left`` or ``right``.
        position: (3,) of the hand in the body frame [m].
    """
    lower, upper = WORKSPACE[side]
    clamped: Array = np.minimum(np.maximum(position, lower), upper)
    return clamped
