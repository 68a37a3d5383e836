"""Operational-space tasks of the QP's cost: J qdd + Jdot v = xdd_des, each with a weight.

Desired accelerations are PD laws around a reference with feed-forward (Seo et al. 2023, eq. 1):
``xdd_des = xdd_ref + kp (x_ref - x) + kd (xd_ref - xd)``.
"""

import numpy as np

from common.native import kernel
from common.robot import joints
from common.robot.rotations import rotation_vector_from_matrix
from common.schemas.arrays import Float64Array as Array
from services.wbc.config import TaskConfig
from services.wbc.gains import Gains
from services.wbc.layout import COM, FEET, FRAMES, HANDS, NV, TORSO, UPPER_BODY
from services.wbc.layout import NUM_ROWS as MOVING_ROWS
from services.wbc.references import PoseReference
from services.wbc.robot_model import Dynamics

POSTURE = slice(MOVING_ROWS, MOVING_ROWS + 13)
NUM_ROWS = POSTURE.stop


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
    """Rows of all tasks, overwritten at every tick: CoM, torso, hands, feet, posture.

    Attributes:
        rows: (43, 32) Jacobian and target side by side.
        jacobian: (43, 31).
        target: (43,) xdd_des - Jdot v.
        weight: (43,).
        kp, kd: (43,) stiffness and damping.
        error: (43,) x_ref - x.
        position: (43,) of the references; rows that stand for rotations are not used.
        rotation: (5, 3, 3) of the references of torso, hands and feet.
        velocity, acceleration: (43,) of the references.
    """

    def __init__(self, config: TaskConfig) -> None:
        self._compiled = kernel("services.wbc._qp")
        # Side by side, so that Hessian and gradient are one product.
        self.rows = np.zeros((NUM_ROWS, NV + 1))
        self.jacobian, self.target = self.rows[:, :NV], self.rows[:, NV]
        # The rows of the posture select the 13 upper-body coordinates and never change.
        self.jacobian[POSTURE, NV - 13 :] = np.eye(13)
        self.weight, self.kp, self.kd = np.zeros((3, NUM_ROWS))
        self.error, self.position, self.velocity, self.acceleration = np.zeros((4, NUM_ROWS))
        self.rotation = np.tile(np.eye(3), (1 + len(FRAMES), 1, 1))
        self._write_gains(COM, *2 * [config.com_horizontal], config.com_vertical)
        self._write_gains(TORSO, *3 * [config.torso])
        for rows in HANDS:
            self._write_gains(rows, *3 * [config.hand_position], *3 * [config.hand_rotation])
        self.kp[POSTURE], self.kd[POSTURE], self.weight[POSTURE] = posture_gains(config)
        self.weight[COM], self.weight[TORSO] = config.com_weight, config.torso_weight
        self._foot = config.foot

    def _write_gains(self, rows: slice, *gains: Gains) -> None:
        self.kp[rows], self.kd[rows] = [g.kp for g in gains], [g.kd for g in gains]

    def follow(self, frame: int, reference: PoseReference) -> None:
        """Let a frame, a place in :data:`FRAMES`, follow a reference."""
        rows = FRAMES[frame]
        self.position[rows.start : rows.start + 3] = reference.position
        self.rotation[1 + frame] = reference.rotation
        self.velocity[rows], self.acceleration[rows] = reference.velocity, reference.acceleration

    def follow_foot(self, side: int, swing: PoseReference | None) -> None:
        """Let a foot follow its swing; None: the ground holds it.

        A standing foot has no acceleration and no position reference.
        """
        rows = FEET[side]
        if swing is None:
            self.kp[rows] = self.kd[rows] = self.acceleration[rows] = 0.0
        else:
            self.kp[rows], self.kd[rows] = self._foot.kp, self._foot.kd
            self.follow(len(HANDS) + side, swing)

    def finish(self, dynamics: Dynamics) -> None:
        """Write errors, Jacobians and targets, once references and weights are written."""
        if self._compiled is not None:
            self._compiled.write_tasks(
                self.rows, self.error, self.kp, self.kd, self.position, self.rotation,
                self.velocity, self.acceleration, dynamics.jacobian, dynamics.velocity,
                dynamics.bias, dynamics.com_position, dynamics.base_rotation,
                dynamics.frame_positions, dynamics.frame_rotations,
                dynamics.motor_position, dynamics.motor_velocity,
            )  # fmt: skip
            return
        self._write_errors(dynamics)
        self.jacobian[:MOVING_ROWS] = dynamics.jacobian
        measured = np.concatenate((dynamics.velocity, dynamics.motor_velocity[UPPER_BODY]))
        target = self.kd * (self.velocity - measured)
        target += self.kp * self.error
        target += self.acceleration
        target[:MOVING_ROWS] -= dynamics.bias
        self.target[:] = target

    def _write_errors(self, dynamics: Dynamics) -> None:
        error, position = self.error, self.position
        error[COM] = position[COM] - dynamics.com_position
        error[POSTURE] = position[POSTURE] - dynamics.motor_position[UPPER_BODY]
        rotations = (dynamics.base_rotation, *dynamics.frame_rotations)
        turns = [
            rotation_vector_from_matrix(wanted.dot(found.T))
            for wanted, found in zip(self.rotation, rotations, strict=True)
        ]
        error[TORSO] = turns[0]
        for rows, turn, found in zip(FRAMES, turns[1:], dynamics.frame_positions, strict=True):
            error[rows] = np.concatenate((position[rows][:3] - found, turn))

    def quadratic(self) -> tuple[Array, Array]:
        """Return Hessian (31, 31) and gradient (31,) of 1/2 sum_i w_i |J_i qdd - target_i|^2."""
        both = (self.weight[:, None] * self.jacobian).T.dot(self.rows)
        return both[:, :NV], -both[:, NV]
