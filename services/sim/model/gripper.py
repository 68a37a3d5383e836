"""Gripper closure 0..1 and the position of the jaw, a finger slide of 0 (closed) to 45 mm."""

from typing import Final

import numpy as np

from common.robot.joints import GRIPPER_CLOSE_COMMAND, GRIPPER_STROKE
from common.schemas.arrays import Float64Array as Array

SQUEEZE_FROM: Final = 0.9
"""From this closure on the command runs ahead of the jaw, up to the full grip force at 1."""


def jaw_command(closure: Array) -> Array:
    """Return the finger position to command [m] for each ``closure`` (clipped to 0..1).

    Below :data:`SQUEEZE_FROM` it is the position itself, so that a half-closed command leaves
    a half-closed hand; above, it goes past contact so that the position servo squeezes.
    """
    closed = np.clip(closure, 0.0, 1.0)
    squeeze = np.maximum(closed - SQUEEZE_FROM, 0.0) / (1.0 - SQUEEZE_FROM)
    return GRIPPER_STROKE * (1.0 - closed) + GRIPPER_CLOSE_COMMAND * squeeze


def jaw_closure(finger: Array) -> Array:
    """Return the closure 0..1 that finger positions [m] amount to."""
    return np.minimum(np.maximum(1.0 - finger / GRIPPER_STROKE, 0.0), 1.0)
