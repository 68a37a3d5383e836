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

from common.robot import frames, joints
from common.robot.rotations import matrix_from_quaternion
from common.schemas import PlantState
from common.schemas.arrays import Float64Array as Array
from services.wbc.clearance import Clearance, ClearanceModel
from services.wbc.errors import ModelError
from services.wbc.mjcf_subset import check_mjcf

NUM_MOTORS = joints.NUM_MOTORS
NV = 6 + NUM_MOTORS
"""Dimension of the reduced velocity."""
SIDES = ("left", "right")
LWA, LOCAL = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED, pin.ReferenceFrame.LOCAL
ARMS = slice(joints.LEFT_ARM.start, joints.RIGHT_ARM.stop)
"""Indices of both arms' joints among the 27."""
COM = slice(0, 3)
TORSO = slice(3, 6)
HANDS = (slice(6, 12), slice(12, 18))
FEET = (slice(18, 24), slice(24, 30))
NUM_ROWS = 30
"""Rows of the stacked Jacobian."""
ARM_COLUMNS = slice(6 + 12, 6 + 24)
"""Velocities of both arms' motors."""


class FrameKinematics(NamedTuple):
    """Pose and motion of a frame, in world (feet) or relative to torso_link (hands).

    Attributes:
        position: (3,) origin [m].
        rotation: (3, 3) frame to world or body.
        velocity: (6,) linear then angular, at the frame's origin [m/s, rad/s].
        jacobian: (6, 31) of ``velocity``.
        bias: (6,) acceleration at zero reduced acceleration (Jdot v) [m/s², rad/s²].
    """

    position: Array
    rotation: Array
    velocity: Array
    jacobian: Array
    bias: Array


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
        rotation = matrix_from_quaternion(state.base_quaternion)
        w, x, y, z = state.base_quaternion.tolist()
        unit = np.array((x, y, z, w))
        unit /= hypot(w, x, y, z)
        return cls(
            np.concatenate((state.base_position, unit, state.joint_position)),
            np.concatenate(
                (
                    rotation.T.dot(state.base_linear_velocity),
                    state.base_angular_velocity,
                    state.joint_velocity,
                )
            ),
        )


class RobotModel:
    """Pinocchio model with locked fingers and merged knees; call :meth:`update` once a tick.

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
        self._merged = _with_merged_knees(self.model)
        self._data = self._merged.createData()
        self._clearance_model = ClearanceModel(self._merged, geometry)
        # Motion relative to the body is that of the arms on a torso at rest at the origin.
        arms = {joints.JOINT_NAMES[i] for i in range(joints.NUM_JOINTS)[ARMS]}
        others = [i for i, name in enumerate(self.model.names) if i and name not in arms]
        self._arm_model = pin.buildReducedModel(self.model, others, pin.neutral(self.model))
        self._arm_data = self._arm_model.createData()
        self.mass = float(pin.computeTotalMass(self.model))
        self._feet = [self._frame_id(self.model, frames.FOOT_FRAMES[side]) for side in SIDES]
        self._hands = [self._frame_id(self._arm_model, frames.HAND_FRAMES[side]) for side in SIDES]
        # A knee coordinate is the mean of its hinges; they differ by what their coupling gives.
        mean = joints.MOTOR_TO_JOINT.T / joints.MOTOR_TO_JOINT.sum(axis=0)[:, None]
        self._to_position = _block_diagonal(np.eye(7), mean)
        self._to_velocity = _block_diagonal(np.eye(6), mean)
        self._upper = np.tri(NV, dtype=bool).T
        self._no_acceleration = np.zeros(NV)
        # Views into pinocchio's memory: to look them up takes longer than to copy what they show.
        self._base_rotation = self._data.oMi[1].rotation
        self._com, self._com_bias = self._data.com[0], self._data.acom[0]
        self._placements = tuple(
            (data.oMf[index].translation, data.oMf[index].rotation)
            for data, indices in ((self._arm_data, self._hands), (self._data, self._feet))
            for index in indices
        )
        self._arms_no_acceleration = np.zeros(self._arm_model.nv)

    @staticmethod
    def _frame_id(model: pin.Model, name: str) -> int:
        if not model.existFrame(name):
            known = sorted(frame.name for frame in model.frames)
            raise ModelError(f"the MJCF has no frame {name!r}; it has {known}")
        return int(model.getFrameId(name))

    def update(self, state: RobotState) -> "Dynamics":
        """Compute the terms that tasks and QP need at ``state``."""
        model, data = self._merged, self._data
        q, v = self._to_position.dot(state.position), self._to_velocity.dot(state.velocity)
        # In this convention the pass for M (upper triangle) computes all Jacobians too.
        mass = pin.crba(model, data, q, pin.Convention.WORLD)
        mass = np.where(self._upper, mass, mass.T)
        force = pin.nonLinearEffects(model, data, q, v)
        # Accelerations at zero joint acceleration are Jdot v of every frame and of the CoM.
        pin.centerOfMass(model, data, q, v, self._no_acceleration, False)
        arms, arm_data = self._arm_model, self._arm_data
        q_arms, v_arms = q[1:][ARM_COLUMNS], v[ARM_COLUMNS]
        pin.computeJointJacobians(arms, arm_data, q_arms)
        pin.forwardKinematics(arms, arm_data, q_arms, v_arms, self._arms_no_acceleration)
        rotation = self._base_rotation.copy()
        jacobian, bias = np.zeros((NUM_ROWS, NV)), np.zeros(NUM_ROWS)
        jacobian[COM] = pin.jacobianCenterOfMass(model, data, False)
        jacobian[TORSO, 3:6] = rotation
        for rows, index in zip(HANDS, self._hands, strict=True):
            jacobian[rows, ARM_COLUMNS] = pin.getFrameJacobian(arms, arm_data, index, LWA)
        for rows, index in zip(FEET, self._feet, strict=True):
            jacobian[rows] = pin.getFrameJacobian(model, data, index, LWA)
        velocity = jacobian.dot(v)
        bias[COM] = self._com_bias
        for rows, index in zip(HANDS, self._hands, strict=True):
            pin.updateFramePlacement(arms, arm_data, index)
            bias[rows] = pin.getFrameClassicalAcceleration(arms, arm_data, index, LWA).vector
        for rows, index in zip(FEET, self._feet, strict=True):
            pin.updateFramePlacement(model, data, index)
            bias[rows] = pin.getFrameClassicalAcceleration(model, data, index, LWA).vector
        left_hand, right_hand, left_foot, right_foot = (
            FrameKinematics(
                position.copy(), turn.copy(), velocity[rows], jacobian[rows], bias[rows]
            )
            for (position, turn), rows in zip(self._placements, (*HANDS, *FEET), strict=True)
        )
        left, right = self._feet
        return Dynamics(
            base_position=state.position[:3],
            base_rotation=rotation,
            base_twist=v[:6],
            motor_position=q[7:],
            motor_velocity=v[6:],
            mass_matrix=mass,
            bias_force=force,
            com_position=self._com.copy(),
            jacobian=jacobian,
            velocity=velocity,
            bias=bias,
            feet=(left_foot, right_foot),
            hands=(left_hand, right_hand),
            sole_jacobians=(
                pin.getFrameJacobian(model, data, left, LOCAL),
                pin.getFrameJacobian(model, data, right, LOCAL),
            ),
            clearance=self._clearance_model.update(data, state.position, v),
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
        hands: (left, right) hand frames relative to torso_link and expressed in it; their
            Jacobians have no base columns, so the QP does not pursue a hand target by moving the
            torso.
        sole_jacobians: (left, right) (6, 31), dual to a wrench [force; moment] in the sole's frame.
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
    feet: tuple[FrameKinematics, FrameKinematics]
    hands: tuple[FrameKinematics, FrameKinematics]
    sole_jacobians: tuple[Array, Array]
    clearance: Clearance

    @property
    def com_velocity(self) -> Array:
        """(3,) in world [m/s]."""
        return self.velocity[COM]
