"""Motor targets without a valid command: hold the position, or only damp."""

from typing import Final

import numpy as np

from common.plant.servo import Target, motor_target
from common.robot.joints import JOINTS, NUM_JOINTS
from common.schemas.arrays import Float64Array as Array

_HOLD: Final[dict[str, tuple[float, float]]] = {
    "hip_ie": (500.0, 10.0),
    "hip_aa": (800.0, 25.0),
    "hip_fe": (800.0, 25.0),
    "knee_fe_jp": (800.0, 8.0),
    "knee_fe_jd": (800.0, 8.0),
    "ankle_fe": (800.0, 6.0),
    "ankle_ie": (800.0, 6.0),
    "shoulder_fe": (100.0, 4.0),
    "shoulder_aa": (100.0, 6.0),
    "shoulder_ie": (60.0, 2.0),
    "elbow_fe": (60.0, 2.0),
    "wrist_ps": (20.0, 0.8),
    "wrist_pitch": (20.0, 0.8),
    "neck_pitch": (20.0, 0.8),
}
"""Stiffness [N·m/rad] and damping [N·m·s/rad] per joint while holding.

A standing robot is an inverted pendulum that topples unless its ankles, in series with knees and
hips, are stiffer than m g h = 36.5 kg · 9.81 m/s² · 0.7 m = 250 N·m/rad. Damping is below half of
the stability limit of an explicit 1 kHz servo for a foot in the air (kd dt / M < 0.5, with
M = 0.012 kg·m²).
"""

_DAMP: Final[dict[str, float]] = {
    "hip_ie": 8.0,
    "hip_aa": 20.0,
    "hip_fe": 20.0,
    "knee_fe_jp": 8.0,
    "knee_fe_jd": 8.0,
    "ankle_fe": 5.0,
    "ankle_ie": 5.0,
    "shoulder_fe": 3.0,
    "shoulder_aa": 3.0,
    "shoulder_ie": 2.0,
    "elbow_fe": 2.0,
    "wrist_ps": 0.6,
    "wrist_pitch": 0.6,
    "neck_pitch": 0.6,
}
"""Damping per joint without a hold, so that the robot sinks and does not drop [N·m·s/rad]."""


def _kind(name: str) -> str:
    return name.removeprefix("l_").removeprefix("r_")


HOLD_STIFFNESS: Final[Array] = np.array([_HOLD[_kind(joint.name)][0] for joint in JOINTS])
HOLD_DAMPING: Final[Array] = np.array([_HOLD[_kind(joint.name)][1] for joint in JOINTS])
DAMP_DAMPING: Final[Array] = np.array([_DAMP[_kind(joint.name)] for joint in JOINTS])
_ZERO: Final[Array] = np.zeros(NUM_JOINTS)


def hold_target(now_ns: int, position: Array, torque: Array) -> Target:
    """Return the target that holds a posture stiffly.

    Args:
        now_ns: robot time [ns].
        position: (27,) [rad].
        torque: (27,) feed-forward [N·m].
    """
    return motor_target(now_ns, position, _ZERO, _ZERO, torque, HOLD_STIFFNESS, HOLD_DAMPING)


def damp_target(now_ns: int) -> Target:
    """Return the target that damps motion and holds no position."""
    return motor_target(now_ns, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, DAMP_DAMPING)
