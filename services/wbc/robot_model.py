"""Rigid-body model of DRACO 3 in 31 reduced coordinates.

The fingers are locked and each rolling-contact knee (two coupled hinges, q_jp = q_jd) is one
coordinate: v = G v_r with a constant G, so M_r = G' M G, h_r = G' h, J_r = J G. The QP thus needs
neither constraint rows nor a null-space projection for the knees.

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
LWA = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
ARMS = slice(joints.LEFT_ARM.start, joints.RIGHT_ARM.stop)
"""Indices of both arms' joints among the 27."""
FOOT_ROWS = (slice(3, 9), slice(9, 15))
HAND_ROWS = (slice(15, 21), slice(21, 27))
"""Rows of the frames in the stacked Jacobian; the first three are the CoM's."""


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
        unit = state.base_quaternion / hypot(*state.base_quaternion.tolist())
        return cls(
            np.concatenate((state.base_position, unit[1:], unit[:1], state.joint_position)),
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
        self.data = self.model.createData()
        self._clearance_model = ClearanceModel(self.model, geometry)
        # Motion relative to the body is that of the arms on a torso at rest at the origin.
        arms = {joints.JOINT_NAMES[i] for i in range(joints.NUM_JOINTS)[ARMS]}
        others = [i for i, name in enumerate(self.model.names) if i and name not in arms]
        self._arm_model = pin.buildReducedModel(self.model, others, pin.neutral(self.model))
        self._arm_data = self._arm_model.createData()
        self.mass = float(pin.computeTotalMass(self.model))
        self._feet = [self._frame_id(self.model, frames.FOOT_FRAMES[side]) for side in SIDES]
        self._hands = [self._frame_id(self._arm_model, frames.HAND_FRAMES[side]) for side in SIDES]
        self._reduction = np.zeros((self.model.nv, NV))
        self._reduction[:6, :6] = np.eye(6)
        self._reduction[6:, 6:] = joints.MOTOR_TO_JOINT
        self._upper = np.tri(self.model.nv, dtype=bool).T
        self._no_acceleration = np.zeros(self.model.nv)
        self._arms_no_acceleration = np.zeros(self._arm_model.nv)
        # Rows of CoM, feet and hands; those of the hands are nonzero in the arms' columns only.
        self._jacobians = np.zeros((27, self.model.nv))
        self.motor_positions = np.array(joints.MOTOR_POSITION_INDEX)

    @staticmethod
    def _frame_id(model: pin.Model, name: str) -> int:
        if not model.existFrame(name):
            known = sorted(frame.name for frame in model.frames)
            raise ModelError(f"the MJCF has no frame {name!r}; it has {known}")
        return int(model.getFrameId(name))

    def reduce_columns(self, matrix: Array) -> Array:
        """Return ``matrix @ G``, which maps (..., 33) to (..., 31)."""
        reduced: Array = matrix.dot(self._reduction)
        return reduced

    def update(self, state: RobotState) -> "Dynamics":
        """Compute the terms that tasks and QP need at ``state``."""
        model, data = self.model, self.data
        q, v = state
        # In this convention the pass for M (upper triangle) computes all Jacobians too.
        pin.crba(model, data, q, pin.Convention.WORLD)
        mass = np.where(self._upper, data.M, data.M.T)
        mass = self.reduce_columns(self.reduce_columns(mass).T)
        bias = self.reduce_columns(pin.nonLinearEffects(model, data, q, v))
        # Accelerations at zero joint acceleration are Jdot v of every frame and of the CoM.
        com = pin.centerOfMass(model, data, q, v, self._no_acceleration, False)
        arms, arm_data = self._arm_model, self._arm_data
        q_arms, v_arms = q[7:][ARMS], v[6:][ARMS]
        pin.computeJointJacobians(arms, arm_data, q_arms)
        pin.forwardKinematics(arms, arm_data, q_arms, v_arms, self._arms_no_acceleration)
        stack = self._jacobians
        stack[:3] = pin.jacobianCenterOfMass(model, data, False)
        for rows, index in zip(FOOT_ROWS, self._feet, strict=True):
            stack[rows] = pin.getFrameJacobian(model, data, index, LWA)
        for rows, index in zip(HAND_ROWS, self._hands, strict=True):
            stack[rows, 6:][:, ARMS] = pin.getFrameJacobian(arms, arm_data, index, LWA)
        jacobians, velocities = self.reduce_columns(stack), stack.dot(v)
        left_foot, right_foot = (
            _frame(model, data, index, jacobians[rows], velocities[rows])
            for rows, index in zip(FOOT_ROWS, self._feet, strict=True)
        )
        left_hand, right_hand = (
            _frame(arms, arm_data, index, jacobians[rows], velocities[rows])
            for rows, index in zip(HAND_ROWS, self._hands, strict=True)
        )
        clearance = self._clearance_model.update(data, q, v)
        return Dynamics(
            base_position=q[:3],
            base_rotation=data.oMi[1].rotation.copy(),
            base_twist=v[:6],
            motor_position=q[7:].take(self.motor_positions),
            motor_velocity=v[6:].take(self.motor_positions),
            mass_matrix=mass,
            bias_force=bias,
            com_position=com.copy(),
            com_velocity=velocities[:3],
            com_jacobian=jacobians[:3],
            com_bias=data.acom[0].copy(),
            feet=(left_foot, right_foot),
            hands=(left_hand, right_hand),
            clearance=clearance._replace(jacobian=self.reduce_columns(clearance.jacobian)),
        )


def _frame(
    model: pin.Model, data: pin.Data, index: int, jacobian: Array, velocity: Array
) -> FrameKinematics:
    """Return a frame's kinematics from its Jacobian and velocity."""
    placement = pin.updateFramePlacement(model, data, index)
    bias = pin.getFrameClassicalAcceleration(model, data, index, LWA).vector
    return FrameKinematics(
        placement.translation.copy(), placement.rotation.copy(), velocity, jacobian, bias
    )


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
        com_velocity: (3,) in world [m/s].
        com_jacobian: (3, 31).
        com_bias: (3,) Jdot v of the CoM [m/s²].
        feet: (left, right) soles in world.
        hands: (left, right) hand frames relative to torso_link and expressed in it; their
            Jacobians have no base columns, so the QP does not pursue a hand target by moving the
            torso.
        clearance: distances of arms and body where they are near each other; Jacobian (k, 31).
    """

    base_position: Array
    base_rotation: Array
    base_twist: Array
    motor_position: Array
    motor_velocity: Array
    mass_matrix: Array
    bias_force: Array
    com_position: Array
    com_velocity: Array
    com_jacobian: Array
    com_bias: Array
    feet: tuple[FrameKinematics, FrameKinematics]
    hands: tuple[FrameKinematics, FrameKinematics]
    clearance: Clearance

    def foot_wrench_jacobian(self, side: int) -> Array:
        """Return the Jacobian (6, 31) dual to a wrench [force; moment] in the foot's own frame."""
        foot = self.feet[side]
        local = np.empty((6, NV))
        to_foot = foot.rotation.T
        np.dot(to_foot, foot.jacobian[:3], out=local[:3])
        np.dot(to_foot, foot.jacobian[3:], out=local[3:])
        return local
