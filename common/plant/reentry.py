"""Re-entry: how the robot comes from a posture of its own back to the controller's commands.

After HOLD, DAMP or SILENT nobody knows that the next command fits the posture the robot is in. For
a while the set-point of each joint is therefore kept near its measured position, within a reach
that grows at a bounded rate, and a command that is far off is refused. A controller that takes the
robot over from its measured posture, as it must, is never affected.
"""

from typing import Final

import numpy as np

from common.schemas import JointCommand
from common.schemas.arrays import Float64Array as Array

DURATION_NS: Final = 500_000_000
"""Robot time from the first command that is applied, in which the rules below hold [ns]."""
FARTHEST: Final = 0.3
"""Distance of a commanded from a measured joint beyond which a command is refused [rad]."""
SLACK: Final = 0.02
"""Distance that is allowed at once: what a joint moves between measurement and command [rad]."""
RATE: Final = 1.0
"""Growth of the allowed distance: a fifth of the slowest joint's rated speed [rad/s]."""


def is_far(command: JointCommand, now_ns: int, measured: Array) -> bool:
    """Return whether a command expects a joint too far from where it is.

    The age of the command is no error: a joint that moves has moved on.

    Args:
        command: with finite numbers.
        now_ns: robot time [ns].
        measured: (27,) joint positions now [rad].
    """
    age = 1e-9 * (now_ns - command.header.stamp)
    distance = np.abs(command.position + age * command.velocity - measured)
    return not bool((distance <= FARTHEST).all())


def eased(position: Array, measured: Array, elapsed_ns: int) -> Array:
    """Return set-points within the reach of the measured positions.

    Args:
        position: (27,) commanded [rad].
        measured: (27,) now [rad].
        elapsed_ns: robot time since the first command was applied [ns].
    """
    reach = SLACK + RATE * 1e-9 * elapsed_ns
    return np.clip(position, measured - reach, measured + reach)
