"""DRACO 3's rigid-body model for the controller, in the 31 coordinates that remain of 33.

The fingers are locked and each rolling-contact knee (two coupled hinges, q_jp = q_jd) is one
coordinate: v = G v_r with a constant G, so M_r = G' M G, h_r = G' h, J_r = J G. No constraint
rows and no null-space projection remain in the QP.

Order of the reduced velocity: base linear and angular velocity in ``torso_link`` (6), then the
25 motors in :data:`common.robot.MOTORS` order.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from common.robot import frames, joints
from common.schemas import PlantState
from common.schemas.arrays import Float64Array as Array
from services.wbc.errors import ModelError
from services.wbc.rotations import cross, matrix_from_quaternion

NUM_MOTORS = joints.NUM_MOTORS
NV = 6 + NUM_MOTORS
"""Size of the reduced velocity."""
SIDES = ("left", "right")
LWA = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
LOCAL = pin.ReferenceFrame.LOCAL


@dataclass(frozen=True)
class FrameKinematics:
    """Pose and motion of one frame.

    Attributes:
        position: (3,) origin in world [m].
        rotation: (3, 3) frame to world.
        velocity: (6,) linear then angular, world axes at the frame's origin [m/s, rad/s].
        jacobian: (6, 31) of ``velocity``.
        bias: (6,) acceleration at zero reduced acceleration (Jdot v) [m/s², rad/s²].
    """

    position: Array
    rotation: Array
    velocity: Array
    jacobian: Array
    bias: Array


@dataclass(frozen=True)
class RobotState:
    """The part of a measured state the model needs, in pinocchio's convention.

    Attributes:
        position: (34,) base position, quaternion (x, y, z, w), 27 joints.
        velocity: (33,) base twist in the body frame, 27 joint velocities.
    """

    position: Array
    velocity: Array

    @classmethod
    def from_plant(cls, state: PlantState) -> "RobotState":
        """Convert a bus message: base velocity from world to body, quaternion to scalar last."""
        rotation = matrix_from_quaternion(state.base_quaternion)
        w, x, y, z = state.base_quaternion / np.linalg.norm(state.base_quaternion)
        return cls(
            np.concatenate((state.base_position, (x, y, z, w), state.joint_position)),
            np.concatenate(
                (
                    rotation.T @ state.base_linear_velocity,
                    state.base_angular_velocity,
                    state.joint_velocity,
                )
            ),
        )


class RobotModel:
    """Pinocchio model with locked fingers and merged knees; call :meth:`update` once a tick.

    Raises:
        ModelError: if the MJCF's joints are not the expected 27 in the expected order.
    """

    def __init__(self) -> None:
        full = pin.buildModelFromMJCF(str(joints.MJCF_PATH))
        locked = [full.getJointId(name) for pair in joints.FINGER_JOINTS.values() for name in pair]
        reference = pin.neutral(full)
        for index in locked:
            reference[full.joints[index].idx_q] = 0.5 * joints.GRIPPER_STROKE
        self.model = pin.buildReducedModel(full, locked, reference)
        names = tuple(self.model.names)[2:]
        if names != joints.JOINT_NAMES:
            raise ModelError(
                f"the MJCF's joints are {names}, expected {joints.JOINT_NAMES}; "
                "restore the order of common/robot/draco3.xml or of JOINTS"
            )
        self.data = self.model.createData()
        self.mass = float(pin.computeTotalMass(self.model))
        self._feet = [self._frame_id(frames.FOOT_FRAMES[side]) for side in SIDES]
        self._hands = [self._frame_id(frames.HAND_FRAMES[side]) for side in SIDES]
        self._knee_columns = [
            (6 + jp, 6 + joints.MOTOR_POSITION_INDEX.index(jd)) for jp, jd in joints.KNEE_INDICES
        ]
        self._keep = np.array([*range(6), *(6 + i for i in joints.MOTOR_POSITION_INDEX)])
        self.motor_positions = np.array(joints.MOTOR_POSITION_INDEX)

    def _frame_id(self, name: str) -> int:
        if not self.model.existFrame(name):
            known = sorted(frame.name for frame in self.model.frames)
            raise ModelError(f"the MJCF has no frame {name!r}; it has {known}")
        return int(self.model.getFrameId(name))

    def reduce_columns(self, matrix: Array) -> Array:
        """Map (n, 33) to (n, 31): ``matrix @ G``."""
        reduced: Array = matrix[:, self._keep]
        for source, target in self._knee_columns:
            reduced[:, target] += matrix[:, source]
        return reduced

    def update(self, state: RobotState) -> "Dynamics":
        """Compute everything the tasks and the QP need at ``state``."""
        model, data = self.model, self.data
        q, v = state.position, state.velocity
        # computeAllTerms leaves nle, M, J, com and acom bias in one pass over the tree.
        pin.computeAllTerms(model, data, q, v)
        mass = np.triu(data.M)
        mass = mass + np.triu(mass, 1).T
        mass_reduced = self.reduce_columns(self.reduce_columns(mass).T)
        bias = self.reduce_columns(data.nle[None, :])[0]
        com_jacobian = self.reduce_columns(pin.jacobianCenterOfMass(model, data, q))
        pin.forwardKinematics(model, data, q, v, np.zeros(model.nv))
        pin.updateFramePlacements(model, data)
        pin.centerOfMass(model, data, pin.KinematicLevel.ACCELERATION)
        return Dynamics(
            base_position=q[:3].copy(),
            base_rotation=data.oMi[1].rotation.copy(),
            base_twist=v[:6].copy(),
            motor_position=q[7:][self.motor_positions],
            motor_velocity=v[6:][self.motor_positions],
            mass_matrix=mass_reduced,
            bias_force=bias,
            com_position=data.com[0].copy(),
            com_velocity=data.vcom[0].copy(),
            com_jacobian=com_jacobian,
            com_bias=data.acom[0].copy(),
            feet=(self._kinematics(self._feet[0]), self._kinematics(self._feet[1])),
            hands=(self._kinematics(self._hands[0]), self._kinematics(self._hands[1])),
        )

    def _kinematics(self, frame: int) -> FrameKinematics:
        model, data = self.model, self.data
        placement = data.oMf[frame]
        return FrameKinematics(
            position=placement.translation.copy(),
            rotation=placement.rotation.copy(),
            velocity=pin.getFrameVelocity(model, data, frame, LWA).vector.copy(),
            jacobian=self.reduce_columns(pin.getFrameJacobian(model, data, frame, LWA)),
            bias=pin.getFrameClassicalAcceleration(model, data, frame, LWA).vector.copy(),
        )


@dataclass(frozen=True)
class Dynamics:
    """Terms of M_r qdd + h_r = S' tau + sum J_f' f at one state, in reduced coordinates.

    Attributes:
        base_position: (3,) torso_link origin in world [m].
        base_rotation: (3, 3) torso_link to world.
        base_twist: (6,) linear then angular velocity in torso_link [m/s, rad/s].
        motor_position, motor_velocity: (25,) [rad, rad/s].
        mass_matrix: (31, 31) M_r with rotor inertia.
        bias_force: (31,) h_r, Coriolis and gravity.
        com_position, com_velocity: (3,) in world.
        com_jacobian: (3, 31); com_bias: (3,) its Jdot v.
        feet, hands: kinematics of (left, right) contact frames.
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

    def hand_in_body(self, side: int) -> FrameKinematics:
        """Motion of a hand relative to torso_link and expressed in it.

        The relative Jacobian has no base columns: the QP cannot chase a hand target by moving
        the torso that carries it. The velocity-product terms follow from the acceleration of a
        point in a rotating frame, a = a_o + R (a_rel + 2 w x v_rel + w x (w x r)).
        """
        hand, rotation = self.hands[side], self.base_rotation
        to_body = rotation.T
        linear, angular = self.base_twist[:3], self.base_twist[3:]
        r = to_body @ (hand.position - self.base_position)
        wxr = cross(angular, r)
        v_rel = to_body @ hand.velocity[:3] - linear - wxr
        w_rel = to_body @ hand.velocity[3:] - angular
        a_rel = (
            to_body @ hand.bias[:3]
            - cross(angular, linear)
            - 2.0 * cross(angular, v_rel)
            - cross(angular, wxr)
        )
        alpha_rel = to_body @ hand.bias[3:] - cross(angular, w_rel)
        jacobian = np.zeros((6, NV))
        jacobian[:3, 6:] = to_body @ hand.jacobian[:3, 6:]
        jacobian[3:, 6:] = to_body @ hand.jacobian[3:, 6:]
        return FrameKinematics(
            position=r,
            rotation=to_body @ hand.rotation,
            velocity=np.concatenate((v_rel, w_rel)),
            jacobian=jacobian,
            bias=np.concatenate((a_rel, alpha_rel)),
        )

    def foot_wrench_jacobian(self, side: int) -> Array:
        """(6, 31) Jacobian dual to a wrench [force; moment] in the foot's own frame."""
        foot = self.feet[side]
        local = np.empty((6, NV))
        local[:3] = foot.rotation.T @ foot.jacobian[:3]
        local[3:] = foot.rotation.T @ foot.jacobian[3:]
        return local
