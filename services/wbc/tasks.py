"""Operational-space tasks of the QP's cost: J qdd + Jdot v = xdd_des, each with a weight.

Desired accelerations are PD laws around a reference with feed-forward (Seo et al. 2023, eq. 1):
``xdd_des = xdd_ref + kp (x_ref - x) + kd (xd_ref - xd)``.
"""

import numpy as np

from common.robot import joints
from common.robot.rotations import rotation_vector_from_matrix
from common.schemas.arrays import Float64Array as Array
from services.wbc.config import Gains, TaskConfig
from services.wbc.references import PoseReference
from services.wbc.robot_model import NV, FrameKinematics

COM = slice(0, 3)
TORSO = slice(3, 6)
HANDS = (slice(6, 12), slice(12, 18))
FEET = (slice(18, 24), slice(24, 30))
POSTURE = slice(30, 43)
NUM_ROWS = 43


def pose_gains(position: Gains, rotation: Gains) -> tuple[Array, Array]:
    """Return stiffness and damping (6,) of a pose task, linear then angular."""
    return (
        np.repeat([position.kp, rotation.kp], 3),
        np.repeat([position.kd, rotation.kd], 3),
    )


def pose_acceleration(
    kinematics: FrameKinematics, reference: PoseReference, kp: Array, kd: Array
) -> Array:
    """Return the desired acceleration (6,) of a frame, linear then angular."""
    error = np.empty(6)
    error[:3] = reference.position - kinematics.position
    error[3:] = rotation_vector_from_matrix(reference.rotation.dot(kinematics.rotation.T))
    result: Array = kp * error
    result += kd * (reference.velocity - kinematics.velocity)
    result += reference.acceleration
    return result


def posture_gains(config: TaskConfig) -> tuple[Array, Array, Array]:
    """Return stiffness, damping and weight (13,) of the upper-body joints in canonical order."""
    rows: list[tuple[float, float, float]] = []
    for joint in joints.JOINTS:
        if joint.group.endswith("leg"):
            continue
        gains, weight = config.posture_wrist, config.posture_weight
        if "shoulder" in joint.name:
            gains = config.posture_shoulder
        elif "elbow" in joint.name:
            gains = config.posture_elbow
        elif joint.group == "neck":
            gains, weight = config.neck, config.neck_weight
        rows.append((gains.kp, gains.kd, weight))
    table = np.array(rows)
    return table[:, 0], table[:, 1], table[:, 2]


class TaskStack:
    """Rows of all tasks, overwritten at every tick.

    Attributes:
        jacobian: (43, 31).
        target: (43,) xdd_des - Jdot v.
        weight: (43,).
    """

    def __init__(self) -> None:
        self.jacobian = np.zeros((NUM_ROWS, NV))
        self.target = np.zeros(NUM_ROWS)
        self.weight = np.zeros(NUM_ROWS)
        # The rows of the posture select the 13 upper-body coordinates and never change.
        self.jacobian[POSTURE, NV - 13 :] = np.eye(13)

    def put(self, rows: slice, jacobian: Array, target: Array, weight: float | Array) -> None:
        """Set one task's rows."""
        self.jacobian[rows] = jacobian
        self.target[rows] = target
        self.weight[rows] = weight

    def quadratic(self) -> tuple[Array, Array]:
        """Return Hessian (31, 31) and gradient (31,) of 1/2 sum_i w_i |J_i qdd - target_i|^2."""
        weighted = (self.weight[:, None] * self.jacobian).T
        return weighted.dot(self.jacobian), -weighted.dot(self.target)
