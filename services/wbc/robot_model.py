"""Rigid-body model of DRACO 3 in 31 reduced coordinates.

The fingers are locked and each rolling-contact knee (two coupled hinges, q_jp = q_jd) is one
coordinate, one hinge mimicking the other: v = G v_r with a constant G. The QP thus needs neither
constraint rows nor a null-space projection for the knees.

Order of the reduced velocity: base linear and angular velocity in ``torso_link`` (6), then the
25 motors in :data:`common.robot.MOTORS` order.
"""

from math import hypot
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from common.robot import joints
from common.robot.rotations import rotate_vector
from common.schemas import PlantState
from common.schemas.arrays import Float64Array as Array
from services.wbc.clearance import Clearance, ClearanceModel
from services.wbc.errors import ModelError
from services.wbc.layout import COM
from services.wbc.mjcf_subset import check_mjcf
from services.wbc.model_terms import make_terms


class FramePose(NamedTuple):
    """Pose of a frame, in world (feet) or relative to torso_link (hands).

    Attributes:
        position: (3,) origin [m].
        rotation: (3, 3) frame to world or body.
    """

    position: Array
    rotation: Array


class RobotState(NamedTuple):
    """Position and velocity of a measured state in pinocchio's convention.

    Attributes:
        position: (34,) base position, quaternion (x, y, z, w), 27 joints.
        velocity: (33,) base twist in the body frame, 27 joint velocities.
    """

    position: Array
    velocity: Array

    @classmethod
    def from_plant(cls, state: PlantState) -> "RobotState":
        """Convert a state message: base velocity to the body frame, quaternion to scalar last."""
        w, x, y, z = state.base_quaternion.tolist()
        norm = hypot(w, x, y, z)
        w, x, y, z = w / norm, x / norm, y / norm, z / norm
        unit = np.array((x, y, z, w))
        to_body = np.array((w, -x, -y, -z))
        return cls(
            np.concatenate((state.base_position, unit, state.joint_position)),
            np.concatenate(
                (
                    rotate_vector(to_body, state.base_linear_velocity),
                    state.base_angular_velocity,
                    state.joint_velocity,
                )
            ),
        )


class RobotModel:
    """Pinocchio model with locked fingers and merged knees; call :meth:`update` once a tick.

    Attributes:
        model: with both hinges of a knee.
        merged: in which one of them mimics the other.
        mass: [kg].
        clearance_model: measures the distances of arms and body.

    Raises:
        ModelError: the MJCF's joints are not the expected 27 in the expected order, or it uses
            what MuJoCo and pinocchio read differently.
    """

    def __init__(self) -> None:
        check_mjcf(joints.MJCF_PATH)
        full = pin.buildModelFromMJCF(str(joints.MJCF_PATH))
        locked = [full.getJointId(name) for pair in joints.FINGER_JOINTS.values() for name in pair]
        reference = pin.neutral(full)
        for index in locked:
            reference[full.joints[index].idx_q] = 0.5 * joints.GRIPPER_STROKE
        geometry = pin.buildGeomFromMJCF(full, str(joints.MJCF_PATH), pin.GeometryType.COLLISION)
        self.model, geometry = pin.buildReducedModel(full, geometry, locked, reference)
        names = tuple(self.model.names)[2:]
        if names != joints.JOINT_NAMES:
            raise ModelError(
                f"the MJCF's joints are {names}, expected {joints.JOINT_NAMES}; "
                "restore the order of common/robot/draco3.xml or of JOINTS"
            )
        self.merged = _with_merged_knees(self.model)
        self._data = self.merged.createData()
        self.clearance_model = ClearanceModel(self.merged, geometry)
        self.mass = float(pin.computeTotalMass(self.model))
        self._terms = make_terms(self.merged, self._data)
        # A knee coordinate is the mean of its hinges; they differ by what their coupling gives.
        mean = joints.MOTOR_TO_JOINT.T / joints.MOTOR_TO_JOINT.sum(axis=0)[:, None]
        self._to_position = _block_diagonal(np.eye(7), mean)
        self._to_velocity = _block_diagonal(np.eye(6), mean)

    def update(self, state: RobotState) -> "Dynamics":
        """Compute the terms that tasks and QP need at ``state``."""
        model, data = self.merged, self._data
        q, v = self._to_position.dot(state.position), self._to_velocity.dot(state.velocity)
        # In this convention the pass for M computes all Jacobians too.
        pin.crba(model, data, q, pin.Convention.WORLD)
        pin.nonLinearEffects(model, data, q, v)
        terms = self._terms.read(q, v)
        left_hand, right_hand, left_foot, right_foot = map(
            FramePose, terms.positions, terms.rotations
        )
        return Dynamics(
            base_position=state.position[:3],
            base_rotation=terms.base_rotation,
            base_twist=v[:6],
            motor_position=q[7:],
            motor_velocity=v[6:],
            mass_matrix=terms.mass_matrix,
            bias_force=terms.bias_force,
            com_position=terms.com_position,
            jacobian=terms.jacobian,
            velocity=terms.velocity,
            bias=terms.bias,
            feet=(left_foot, right_foot),
            hands=(left_hand, right_hand),
            frame_positions=terms.positions,
            frame_rotations=terms.rotations,
            sole_jacobians=terms.soles,
            clearance=self.clearance_model.update(data, state.position, v),
        )


def _with_merged_knees(model: pin.Model) -> pin.Model:
    """Return the model in which the second hinge of a knee mimics the first."""
    merged = model
    for hinges in joints.MOTOR_TO_JOINT.T:
        first, *others = (model.getJointId(joints.JOINT_NAMES[i]) for i in np.flatnonzero(hinges))
        for other in others:
            merged = pin.transformJointIntoMimic(merged, first, other, 1.0, 0.0)
    # The coordinate of a knee turns both rotors.
    armature = model.armature
    merged.armature = np.concatenate((armature[:6], joints.MOTOR_TO_JOINT.T @ armature[6:]))
    return merged


def _block_diagonal(first: Array, second: Array) -> Array:
    upper = np.hstack((first, np.zeros((len(first), second.shape[1]))))
    lower = np.hstack((np.zeros((len(second), first.shape[1])), second))
    return np.vstack((upper, lower))


class Dynamics(NamedTuple):
    """Terms of M_r qdd + h_r = S' tau + sum J_f' f at one state, in reduced coordinates.

    Attributes:
        base_position: (3,) torso_link origin in world [m].
        base_rotation: (3, 3) torso_link to world.
        base_twist: (6,) linear then angular velocity in torso_link [m/s, rad/s].
        motor_position: (25,) [rad].
        motor_velocity: (25,) [rad/s].
        mass_matrix: (31, 31) M_r with rotor inertia.
        bias_force: (31,) h_r, Coriolis and gravity.
        com_position: (3,) in world [m].
        jacobian: (30, 31) of ``velocity``.
        velocity: (30,) of CoM, torso (angular, in world), hands and feet, at the rows named above.
        bias: (30,) their accelerations at zero reduced acceleration (Jdot v); zero for the torso,
            whose angular velocity is a constant turned by its own rotation.
        feet: (left, right) soles in world.
        frame_positions: (4, 3) of hands and feet, as in ``hands`` and ``feet`` [m].
        frame_rotations: (4, 3, 3) likewise.
        hands: (left, right) hand frames relative to torso_link and expressed in it; their
            Jacobians have no base columns, so the QP does not pursue a hand target by moving the
            torso.
        sole_jacobians: (2, 6, 31) left and right, dual to a wrench [force; moment] in the sole's
            frame.
        clearance: distances of arms and body where they are near each other.
    """

    base_position: Array
    base_rotation: Array
    base_twist: Array
    motor_position: Array
    motor_velocity: Array
    mass_matrix: Array
    bias_force: Array
    com_position: Array
    jacobian: Array
    velocity: Array
    bias: Array
    feet: tuple[FramePose, FramePose]
    hands: tuple[FramePose, FramePose]
    frame_positions: Array
    frame_rotations: Array
    sole_jacobians: Array
    clearance: Clearance

    @property
    def com_velocity(self) -> Array:
        """(3,) in world [m/s]."""
        return self.velocity[COM]
