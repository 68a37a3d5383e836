"""Bounds of a joint command: gains with which the servo is stable, and possible joint values.

A command beyond them is refused as wrong. Within them the servo still limits torques to those of
the motors, and spares the joints' stops.
"""

from typing import Final

import numpy as np

from common.robot.joints import (
    EFFORT_RELAXED,
    JOINTS,
    NUM_JOINTS,
    POSITION_LOWER,
    POSITION_UPPER,
    VELOCITY_LIMIT,
)
from common.schemas.arrays import Float64Array as Array

_SERVO_STEP: Final = 1e-3

_EFFECTIVE_INERTIA: Final[dict[str, float]] = {
    "hip_ie": 0.0273,
    "hip_aa": 0.366,
    "hip_fe": 0.0614,
    "knee_fe_jp": 0.020,
    "knee_fe_jd": 0.020,
    "ankle_fe": 0.0119,
    "ankle_ie": 0.0116,
    "shoulder_fe": 0.081,
    "shoulder_aa": 0.300,
    "shoulder_ie": 0.0164,
    "elbow_fe": 0.0217,
    "wrist_ps": 0.0120,
    "wrist_pitch": 0.0137,
    "neck_pitch": 0.0176,
}
"""1 / diag(M^-1) in the nominal crouch with free feet [kg·m²]: the least inertia at a motor."""


def _inertia(name: str) -> float:
    return _EFFECTIVE_INERTIA[name.removeprefix("l_").removeprefix("r_")]


EFFECTIVE_INERTIA: Final[Array] = np.array([_inertia(joint.name) for joint in JOINTS])

DAMPING_MAX: Final[Array] = EFFECTIVE_INERTIA / _SERVO_STEP
"""(27,) from kd dt / M = 1, beyond which an explicit damper reverses a velocity in one step."""

STIFFNESS_MAX: Final[Array] = np.full(NUM_JOINTS, 1000.0)
"""(27,) [N·m/rad]."""

POSITION_MARGIN: Final = 0.2
"""Allowance beyond a joint's stop, for measurement noise and penetration [rad]."""

POSITION_MIN: Final[Array] = POSITION_LOWER - POSITION_MARGIN
POSITION_MAX: Final[Array] = POSITION_UPPER + POSITION_MARGIN
VELOCITY_MAX: Final[Array] = 5.0 * VELOCITY_LIMIT
"""(27,) wide, since commands hold the measured velocity, which peaks at touch-down [rad/s]."""
ACCELERATION_MAX: Final[Array] = np.full(NUM_JOINTS, 2e3)
"""(27,) [rad/s²]."""
TORQUE_MAX: Final[Array] = 2.0 * EFFORT_RELAXED
"""(27,) of the feed-forward; the servo applies the motors' limit [N·m]."""
CLOSURE_MARGIN: Final = 0.05
"""Allowance of gripper closures outside 0..1."""
