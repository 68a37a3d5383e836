"""Gains of the joint PD that the plant applies around a command."""

import numpy as np

from common.robot import joints
from common.schemas.arrays import Float64Array as Array
from services.wbc.config import MotorGains


def joint_gains(motors: MotorGains) -> tuple[Array, Array]:
    """Stiffness [N·m/rad] and damping [N·m·s/rad] (27,) that the plant applies around a command.

    A knee's gain is meant for its coordinate, so each of the two hinges gets half.
    """
    table = {
        "hip": motors.hip,
        "knee": motors.knee,
        "ankle": motors.ankle,
        "shoulder": motors.shoulder,
        "elbow": motors.elbow,
        "wrist": motors.wrist,
        "neck": motors.neck,
    }
    stiffness, damping = np.zeros(joints.NUM_JOINTS), np.zeros(joints.NUM_JOINTS)
    for index, joint in enumerate(joints.JOINTS):
        part = next(name for name in table if name in joint.name)
        share = 0.5 if part == "knee" else 1.0
        stiffness[index] = share * table[part].kp
        damping[index] = share * table[part].kd
    return stiffness, damping
