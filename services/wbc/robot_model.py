"""DRACO 3's rigid-body model for the controller, in the 31 coordinates that remain of 33.

The fingers are locked and each rolling-contact knee (two coupled hinges, q_jp = q_jd) is one
coordinate: v = G v_r with a constant G, so M_r = G' M G, h_r = G' h, J_r = J G. No constraint
rows and no null-space projection remain in the QP.

Order of the reduced velocity: base linear and angular velocity in ``torso_link`` (6), then the
25 motors in :data:`common.robot.MOTORS` order.
"""

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from common.robot import frames, joints
from common.schemas import PlantState
from common.schemas.arrays import Float64Array as Array
from services.wbc.errors import ModelError
from services.wbc.rotations import matrix_from_quaternion

NUM_MOTORS = joints.NUM_MOTORS
NV = 6 + NUM_MOTORS
"""Size of the reduced velocity."""
SIDES = ("left", "right")
LWA = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


class FrameKinematics(NamedTuple):
    """Pose and motion of one frame, in world (feet) or in torso_link (hands).

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
        w, x, y, z = state.base_quaternion / np.sqrt(state.base_quaternion @ state.base_quaternion)
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
        # The same tree with its torso at rest at the origin: motion relative to the body.
        self._body_data = self.model.createData()
        self.mass = float(pin.computeTotalMass(self.model))
        self._feet = [self._frame_id(frames.FOOT_FRAMES[side]) for side in SIDES]
        self._hands = [self._frame_id(frames.HAND_FRAMES[side]) for side in SIDES]
        self._knee_columns = [
            (6 + jp, 6 + joints.MOTOR_POSITION_INDEX.index(jd)) for jp, jd in joints.KNEE_INDICES
        ]
        self._keep = np.array([*range(6), *(6 + i for i in joints.MOTOR_POSITION_INDEX)])
        self._lower = np.tril_indices(self.model.nv, -1)
        self._no_acceleration = np.zeros(self.model.nv)
        self._jacobians = np.empty((27, self.model.nv))
        self.motor_positions = np.array(joints.MOTOR_POSITION_INDEX)

    def _frame_id(self, name: str) -> int:
        if not self.model.existFrame(name):
            known = sorted(frame.name for frame in self.model.frames)
            raise ModelError(f"the MJCF has no frame {name!r}; it has {known}")
        return int(self.model.getFrameId(name))

    def reduce_columns(self, matrix: Array) -> Array:
        """Map (n, 33) to (n, 31): ``matrix @ G``."""
        reduced: Array = matrix.take(self._keep, axis=1)
        for source, target in self._knee_columns:
            reduced[:, target] += matrix[:, source]
        return reduced

    def update(self, state: RobotState) -> "Dynamics":
        """Compute everything the tasks and the QP need at ``state``."""
        model, data = self.model, self.data
        q, v = state
        # One pass leaves M (upper triangle), h, all Jacobians and the CoM's.
        pin.computeAllTerms(model, data, q, v)
        mass = data.M
        mass[self._lower] = mass.T[self._lower]
        mass = self.reduce_columns(self.reduce_columns(mass).T)
        bias = self.reduce_columns(data.nle[None, :])[0]
        # Accelerations at zero joint acceleration are the Jdot v of every frame and of the CoM.
        pin.centerOfMass(model, data, q, v, self._no_acceleration)
        feet = [self._frame(data, index) for index in self._feet]
        body = self._body_data
        q_body, v_body = q.copy(), v.copy()
        q_body[:7] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
        v_body[:6] = 0.0
        pin.computeJointJacobians(model, body, q_body)
        pin.forwardKinematics(model, body, q_body, v_body, self._no_acceleration)
        hands = [self._frame(body, index) for index in self._hands]
        stack = self._jacobians
        stack[:3] = data.Jcom
        for row, (_, _, _, jacobian, _) in zip((3, 9, 15, 21), feet + hands, strict=True):
            stack[row : row + 6] = jacobian
        # Relative to the torso, a hand moves by its arm alone.
        stack[15:, :6] = 0.0
        reduced = self.reduce_columns(stack)
        return Dynamics(
            base_position=q[:3],
            base_rotation=data.oMi[1].rotation.copy(),
            base_twist=v[:6],
            motor_position=q[7:].take(self.motor_positions),
            motor_velocity=v[6:].take(self.motor_positions),
            mass_matrix=mass,
            bias_force=bias,
            com_position=data.com[0].copy(),
            com_velocity=data.vcom[0].copy(),
            com_jacobian=reduced[:3],
            com_bias=data.acom[0].copy(),
            feet=(
                feet[0]._replace(jacobian=reduced[3:9]),
                feet[1]._replace(jacobian=reduced[9:15]),
            ),
            hands=(
                hands[0]._replace(jacobian=reduced[15:21]),
                hands[1]._replace(jacobian=reduced[21:27]),
            ),
        )

    def _frame(self, data: pin.Data, index: int) -> FrameKinematics:
        """Kinematics of a frame with its Jacobian still in 33 columns."""
        model = self.model
        placement = pin.updateFramePlacement(model, data, index)
        return FrameKinematics(
            position=placement.translation.copy(),
            rotation=placement.rotation.copy(),
            velocity=pin.getFrameVelocity(model, data, index, LWA).vector,
            jacobian=pin.getFrameJacobian(model, data, index, LWA),
            bias=pin.getFrameClassicalAcceleration(model, data, index, LWA).vector,
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
            Jacobians have no base columns, so the QP cannot chase a hand target by moving the
            torso that carries it.
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

    def foot_wrench_jacobian(self, side: int) -> Array:
        """(6, 31) Jacobian dual to a wrench [force; moment] in the foot's own frame."""
        foot = self.feet[side]
        local = np.empty((6, NV))
        to_foot = foot.rotation.T
        local[:3] = to_foot @ foot.jacobian[:3]
        local[3:] = to_foot @ foot.jacobian[3:]
        return local
