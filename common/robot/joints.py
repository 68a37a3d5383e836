"""DRACO 3's joints and motors as one typed table, and the numpy arrays derived from it.

The canonical joint order is the depth-first order of ``draco3.xml``: left leg (7), right leg (7),
left arm (6), right arm (6), neck. MuJoCo and pinocchio both keep it; their configuration vectors
also hold the four finger slides (two after each wrist), which are not counted among the 27 joints.

Units: rad, rad/s, N·m; m for the finger slides. Limits are those of the public DRACO 3 URDF; the
relaxed effort is that of the public TRILL simulation (URDF effort plus 200 N·m on every leg joint).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from common.schemas.arrays import Float64Array as Array

MJCF_PATH: Final = Path(__file__).with_name("draco3.xml")
"""The robot alone, no floor or light; read by MuJoCo and ``pinocchio.buildModelFromMJCF``."""

RELAXED_LEG_MARGIN: Final = 200.0
"""N·m added to each leg joint's effort by the public TRILL simulation."""

ARMATURE: Final = 0.01
"""Rotor inertia reflected to each of the 27 joints, kg·m²."""


@dataclass(frozen=True, slots=True)
class JointSpec:
    """One revolute joint.

    Attributes:
        name: name in the MJCF (and of its motor, but for the knees).
        group: ``left_leg``, ``right_leg``, ``left_arm``, ``right_arm`` or ``neck``.
        lower, upper: position limits, rad.
        velocity: velocity limit, rad/s.
        effort: rated (URDF) effort, N·m.
        nominal: position in the public nominal crouch, rad.
    """

    name: str
    group: str
    lower: float
    upper: float
    velocity: float
    effort: float
    nominal: float = 0.0

    @property
    def relaxed_effort(self) -> float:
        """Effort limit of the public simulation, N·m."""
        return self.effort + (RELAXED_LEG_MARGIN if self.group.endswith("leg") else 0.0)


@dataclass(frozen=True, slots=True)
class MotorSpec:
    """One actuated coordinate: joints that a motor turns together by equal angles and torques.

    Attributes:
        name: actuator name in the MJCF.
        joints: one joint, or a knee's ``(jp, jd)``. A motor torque T acts as T on each of them, so
            that on the coordinate q = jp = jd it is worth 2 T.
    """

    name: str
    joints: tuple[str, ...]


def _leg(side: str) -> tuple[JointSpec, ...]:
    left = side == "left"
    group, p, sign = f"{side}_leg", side[0], 1.0 if left else -1.0
    hip_aa = (-0.261799, 0.785398) if left else (-0.785398, 0.261799)
    ankle_ie = (-0.785398, 0.261799) if left else (-0.261799, 0.785398)
    return (
        JointSpec(f"{p}_hip_ie", group, -0.872665, 0.872665, 8.1, 44.0),
        JointSpec(f"{p}_hip_aa", group, *hip_aa, 5.1, 56.0, sign * 0.087266),
        JointSpec(f"{p}_hip_fe", group, -1.52716, 0.523599, 36.7, 59.6, -0.7854),
        JointSpec(f"{p}_knee_fe_jp", group, -0.0872665, 1.52716, 13.35, 40.85, 0.7854),
        JointSpec(f"{p}_knee_fe_jd", group, -0.0872665, 1.52716, 13.35, 40.85, 0.7854),
        JointSpec(f"{p}_ankle_fe", group, -1.5708, 1.0472, 8.1, 44.0, -0.7854),
        JointSpec(f"{p}_ankle_ie", group, *ankle_ie, 11.1, 30.0, sign * -0.087266),
    )


def _arm(side: str) -> tuple[JointSpec, ...]:
    left = side == "left"
    group, p, sign = f"{side}_arm", side[0], 1.0 if left else -1.0
    shoulder_aa = (0.0, 2.0944) if left else (-2.0944, 0.0)
    return (
        JointSpec(f"{p}_shoulder_fe", group, -2.26893, 0.698132, 30.0, 18.0),
        JointSpec(f"{p}_shoulder_aa", group, *shoulder_aa, 30.0, 18.0, sign * 0.5236),
        JointSpec(f"{p}_shoulder_ie", group, -1.48353, 1.48353, 30.0, 18.0),
        JointSpec(f"{p}_elbow_fe", group, -2.0944, 0.0872665, 37.1, 10.0, -1.5708),
        JointSpec(f"{p}_wrist_ps", group, -1.5708, 1.5708, 44.5, 12.0),
        JointSpec(f"{p}_wrist_pitch", group, -1.5708, 1.5708, 82.8, 8.8),
    )


JOINTS: Final[tuple[JointSpec, ...]] = (
    *_leg("left"),
    *_leg("right"),
    *_arm("left"),
    *_arm("right"),
    JointSpec("neck_pitch", "neck", -0.523599, 1.309, 82.8, 8.8),
)
"""The 27 joints in canonical order."""

JOINT_NAMES: Final[tuple[str, ...]] = tuple(joint.name for joint in JOINTS)
JOINT_INDEX: Final[Mapping[str, int]] = {name: i for i, name in enumerate(JOINT_NAMES)}
NUM_JOINTS: Final = len(JOINTS)


def _group(name: str) -> slice:
    members = [i for i, joint in enumerate(JOINTS) if joint.group == name]
    return slice(members[0], members[-1] + 1)


LEFT_LEG: Final = _group("left_leg")
RIGHT_LEG: Final = _group("right_leg")
LEFT_ARM: Final = _group("left_arm")
RIGHT_ARM: Final = _group("right_arm")
NECK: Final = _group("neck")

KNEE_JOINTS: Final[tuple[tuple[str, str], ...]] = (
    ("l_knee_fe_jp", "l_knee_fe_jd"),
    ("r_knee_fe_jp", "r_knee_fe_jd"),
)
"""(thigh-side hinge jp, shank-side hinge jd) of each knee, coupled by jp = jd."""

KNEE_INDICES: Final[tuple[tuple[int, int], ...]] = tuple(
    (JOINT_INDEX[jp], JOINT_INDEX[jd]) for jp, jd in KNEE_JOINTS
)


def _frozen(values: list[float] | Array) -> Array:
    """Return a read-only float64 copy, for every importer shares these arrays."""
    array = np.array(values, dtype=np.float64)
    array.setflags(write=False)
    return array


POSITION_LOWER: Final = _frozen([joint.lower for joint in JOINTS])
POSITION_UPPER: Final = _frozen([joint.upper for joint in JOINTS])
VELOCITY_LIMIT: Final = _frozen([joint.velocity for joint in JOINTS])
EFFORT_RATED: Final = _frozen([joint.effort for joint in JOINTS])
"""(27,) URDF efforts, N·m. A knee hinge carries 40.85, so the knee coordinate carries 81.7."""
EFFORT_RELAXED: Final = _frozen([joint.relaxed_effort for joint in JOINTS])
"""(27,) N·m; the motors' ctrlrange in the MJCF. Per knee hinge, as ``EFFORT_RATED``."""
NOMINAL_POSITION: Final = _frozen([joint.nominal for joint in JOINTS])
"""(27,) the public nominal crouch, rad."""
NOMINAL_BASE_HEIGHT: Final = 0.743
"""Height of the torso frame above the floor in the nominal crouch, m (soles 3 mm up)."""


def _motor(joint: JointSpec) -> MotorSpec | None:
    for jp, jd in KNEE_JOINTS:
        if joint.name == jp:
            return None
        if joint.name == jd:
            return MotorSpec(f"{jp[0]}_knee", (jp, jd))
    return MotorSpec(joint.name, (joint.name,))


MOTORS: Final[tuple[MotorSpec, ...]] = tuple(m for m in map(_motor, JOINTS) if m is not None)
"""The 25 motors in canonical order; a knee's motor is in the place of its jd."""
MOTOR_NAMES: Final[tuple[str, ...]] = tuple(motor.name for motor in MOTORS)
NUM_MOTORS: Final = len(MOTORS)


def _coupling() -> Array:
    matrix = np.zeros((NUM_JOINTS, NUM_MOTORS))
    for column, motor in enumerate(MOTORS):
        for name in motor.joints:
            matrix[JOINT_INDEX[name], column] = 1.0
    return matrix


MOTOR_TO_JOINT: Final = _frozen(_coupling())
"""(27, 25) G. Positions and velocities: q = G q_m. Torques: tau = G T, and on q_m worth G' tau.

By virtual work both roles share one matrix; G'G is 2 on the knees and 1 elsewhere.
"""

MOTOR_POSITION_INDEX: Final[tuple[int, ...]] = tuple(
    JOINT_INDEX[motor.joints[-1]] for motor in MOTORS
)
"""Index of the joint that measures each motor's coordinate (jd for a knee)."""

FINGER_JOINTS: Final[Mapping[str, tuple[str, str]]] = {
    "left": ("l_finger_a", "l_finger_b"),
    "right": ("r_finger_a", "r_finger_b"),
}
"""Finger slides of each hand: a opens towards the wrist's +y, b towards -y; b is coupled to a."""
GRIPPER_ACTUATORS: Final[Mapping[str, str]] = {"left": "l_gripper", "right": "r_gripper"}
GRIPPER_STROKE: Final = 0.045
"""Travel of each finger, m: 0 closed (pads touch), 0.045 open (90 mm between pads)."""
GRIPPER_OPEN_COMMAND: Final = 0.045
GRIPPER_CLOSE_COMMAND: Final = -0.02
"""Position commanded beyond contact, so that the servo squeezes with up to ``GRIPPER_FORCE``."""
GRIPPER_FORCE: Final = 60.0
"""Force limit of the gripper's position servo, N."""
