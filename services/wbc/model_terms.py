"""Terms of the robot's model at one state, from what pinocchio's passes leave in its memory.

:class:`CompiledTerms` reads that memory in compiled code. :class:`PinocchioTerms` asks pinocchio
for the same and is used where the kernel is not built.
"""

from types import ModuleType
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from common.native import kernel
from common.robot import frames, joints
from common.schemas.arrays import Float64Array as Array
from services.wbc.errors import ModelError
from services.wbc.layout import ARM_COLUMNS, COM, FEET, HANDS, NUM_ROWS, NV, SIDES, TORSO

LWA, LOCAL = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED, pin.ReferenceFrame.LOCAL


class Terms(NamedTuple):
    """Terms that follow from the passes for M and h; those of the same name are Dynamics' own.

    Attributes:
        base_rotation: (3, 3).
        com_position: (3,) [m].
        mass_matrix: (31, 31).
        bias_force: (31,).
        jacobian: (30, 31).
        velocity: (30,).
        bias: (30,).
        positions: (4, 3) of left and right hand relative to torso_link, left and right sole [m].
        rotations: (4, 3, 3) likewise.
        soles: (2, 6, 31) Jacobians of the soles in their own frames.
    """

    base_rotation: Array
    com_position: Array
    mass_matrix: Array
    bias_force: Array
    jacobian: Array
    velocity: Array
    bias: Array
    positions: Array
    rotations: Array
    soles: Array


def frame_id(model: pin.Model, name: str) -> int:
    """Return the index of a frame.

    Raises:
        ModelError: there is none of that name.
    """
    if not model.existFrame(name):
        known = sorted(frame.name for frame in model.frames)
        raise ModelError(f"the MJCF has no frame {name!r}; it has {known}")
    return int(model.getFrameId(name))


def make_terms(model: pin.Model, data: pin.Data) -> "PinocchioTerms | CompiledTerms":
    """Return what reads the terms of a model with merged knees.

    Raises:
        ModelError: the model has not the frames of hands and feet.
    """
    compiled = kernel("services.wbc._model_terms")
    return PinocchioTerms(model, data) if compiled is None else CompiledTerms(model, data, compiled)


class PinocchioTerms:
    """The terms by pinocchio's own functions."""

    def __init__(self, model: pin.Model, data: pin.Data) -> None:
        self._model, self._data = model, data
        # Motion relative to the body is that of the arms on a torso at rest at the origin.
        arms = {*joints.JOINT_NAMES[joints.LEFT_ARM], *joints.JOINT_NAMES[joints.RIGHT_ARM]}
        others = [i for i, name in enumerate(model.names) if i and name not in arms]
        self._arm_model = pin.buildReducedModel(model, others, pin.neutral(model))
        self._arm_data = self._arm_model.createData()
        self._feet = [frame_id(model, frames.FOOT_FRAMES[side]) for side in SIDES]
        self._hands = [frame_id(self._arm_model, frames.HAND_FRAMES[side]) for side in SIDES]
        self._upper = np.tri(NV, dtype=bool).T

    def read(self, q: Array, v: Array) -> Terms:
        """Return the terms at the position and velocity of the passes for M and h."""
        model, data, arms, arm_data = self._model, self._data, self._arm_model, self._arm_data
        pin.centerOfMass(model, data, q, v, np.zeros(NV), False)
        pin.computeJointJacobians(arms, arm_data, q[1:][ARM_COLUMNS])
        # Accelerations at zero joint acceleration are Jdot v.
        still = np.zeros(arms.nv)
        pin.forwardKinematics(arms, arm_data, q[1:][ARM_COLUMNS], v[ARM_COLUMNS], still)
        rotation = data.oMi[1].rotation.copy()
        jacobian, bias = np.zeros((NUM_ROWS, NV)), np.zeros(NUM_ROWS)
        jacobian[COM] = pin.jacobianCenterOfMass(model, data, False)
        jacobian[TORSO, 3:6], bias[COM] = rotation, data.acom[0]
        positions, rotations = np.zeros((4, 3)), np.zeros((4, 3, 3))
        hands, feet = zip(HANDS, self._hands, strict=True), zip(FEET, self._feet, strict=True)
        frames_of = [(arms, arm_data, ARM_COLUMNS, *hand) for hand in hands]
        frames_of += [(model, data, slice(NV), *foot) for foot in feet]
        for i, (owner, memory, columns, rows, index) in enumerate(frames_of):
            jacobian[rows, columns] = pin.getFrameJacobian(owner, memory, index, LWA)
            placement = pin.updateFramePlacement(owner, memory, index)
            positions[i], rotations[i] = placement.translation, placement.rotation
            bias[rows] = pin.getFrameClassicalAcceleration(owner, memory, index, LWA).vector
        return Terms(
            rotation,
            data.com[0].copy(),
            np.where(self._upper, data.M, data.M.T),
            data.nle.copy(),
            jacobian,
            jacobian.dot(v),
            bias,
            positions,
            rotations,
            np.array([pin.getFrameJacobian(model, data, index, LOCAL) for index in self._feet]),
        )


class CompiledTerms:
    """The same by the kernel."""

    def __init__(self, model: pin.Model, data: pin.Data, compiled: ModuleType) -> None:
        self._update = compiled.update
        names = (
            *(frames.HAND_FRAMES[side] for side in SIDES),
            *(frames.FOOT_FRAMES[side] for side in SIDES),
        )
        limbs = [_limb(model, data, name, floating=i >= 2) for i, name in enumerate(names)]
        base = data.oMi[1]
        # Views into the memory of data, which has to stay. Pinocchio's matrices are column-major.
        self._data = data
        self._prepared = compiled.prepare(
            data.J.T, data.M.T, data.nle, base.rotation.T, base.translation,
            tuple(model.gravity.linear.tolist()), *limbs,
        )  # fmt: skip

    def read(self, q: Array, v: Array) -> Terms:
        """Return the terms at the position and velocity of the passes for M and h."""
        empty = np.empty
        terms = Terms(
            empty((3, 3)), empty(3), empty((NV, NV)), empty(NV), empty((NUM_ROWS, NV)),
            empty(NUM_ROWS), empty(NUM_ROWS), empty((4, 3)), empty((4, 3, 3)), empty((2, 6, NV)),
        )  # fmt: skip
        self._update(self._prepared, v, *terms)
        return terms


def _limb(model: pin.Model, data: pin.Data, name: str, *, floating: bool) -> tuple[object, ...]:
    """Describe a frame to the kernel: placement and joints from the base, with it or without.

    Raises:
        ModelError: there is no such frame, or it is turned against its joint.
    """
    frame = model.frames[frame_id(model, name)]
    if not np.array_equal(frame.placement.rotation, np.eye(3)):
        raise ModelError(f"frame {name!r} is turned against its joint, expected parallel axes")
    chain = [model.joints[i] for i in model.supports[frame.parentJoint]][1 if floating else 2 :]
    pairs = []
    for joint in chain:
        count = max(joint.nv, 1)  # A hinge that mimics another has none of its own.
        pairs += [(joint.idx_vExtended + k, joint.idx_v + k) for k in range(count)]
    columns, velocities = zip(*pairs, strict=True)
    placement = data.oMi[frame.parentJoint]
    return (
        placement.rotation.T,
        placement.translation,
        tuple(frame.placement.translation.tolist()),
        bytes(columns),
        bytes(velocities),
        int(floating),
    )
