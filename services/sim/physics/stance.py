"""Initial pose of the robot: feet flat on the floor, torso upright, CoM above the feet."""

from typing import Any

import mujoco
import numpy as np

from common.plant.servo import JOINT_TO_MOTOR
from common.robot.frames import BASE_JOINT, FOOT_FRAMES
from common.robot.joints import (
    FINGER_JOINTS,
    GRIPPER_STROKE,
    JOINT_INDEX,
    MOTOR_TO_JOINT,
    NOMINAL_POSITION,
)
from common.schemas.arrays import Float64Array as Array
from services.sim.errors import StandError
from services.sim.model.world import Addresses

_TOLERANCE = 1e-6
_ITERATIONS = 30
_STEP = 1e-6


def standing_joints(knee: float, lean: float, spread: float) -> Array:
    """Return nominal joint positions (27,) with these leg angles; the feet stay flat [rad].

    A leg's pitches sum to zero (hip + 2 knee + ankle) and its rolls cancel, so that the soles stay
    level under an upright torso.

    Args:
        knee: angle of each half of the knee.
        lean: rotation of the leg about the hip; a negative one moves the foot forward.
        spread: hip abduction of both legs, outward if positive.
    """
    joints = NOMINAL_POSITION.copy()
    for side, outward in (("l", 1.0), ("r", -1.0)):
        joints[JOINT_INDEX[f"{side}_hip_aa"]] = outward * spread
        joints[JOINT_INDEX[f"{side}_hip_fe"]] = -knee + lean
        joints[JOINT_INDEX[f"{side}_knee_fe_jp"]] = knee
        joints[JOINT_INDEX[f"{side}_knee_fe_jd"]] = knee
        joints[JOINT_INDEX[f"{side}_ankle_fe"]] = -knee - lean
        joints[JOINT_INDEX[f"{side}_ankle_ie"]] = -outward * spread
    return joints


def standing_qpos(model: Any, addresses: Addresses, com_height: float, width: float) -> Array:
    """Return ``qpos`` (nq,) standing at the origin, soles on z = 0, grippers open.

    Newton's method finds knee, lean and spread from three conditions: the CoM's height above the
    soles, the CoM above the middle of the feet in x, and the distance between the feet.

    Args:
        model: the ``mujoco.MjModel``.
        addresses: of the robot in the model.
        com_height: CoM above the soles [m].
        width: between the soles' centres [m].

    Raises:
        StandError: the legs cannot do that.
    """
    data = mujoco.MjData(model)
    left, right = (data.site(FOOT_FRAMES[side]) for side in ("left", "right"))

    def residual(unknown: Array) -> Array:
        data.qpos[addresses.qpos] = standing_joints(*unknown)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        middle = 0.5 * (left.xpos + right.xpos)
        com = data.subtree_com[addresses.torso]
        return np.array(
            [
                com[2] - middle[2] - com_height,
                com[0] - middle[0],
                left.xpos[1] - right.xpos[1] - width,
            ]
        )

    for side in ("left", "right"):
        for name in FINGER_JOINTS[side]:
            data.joint(name).qpos[:] = GRIPPER_STROKE
    unknown = np.array([0.6, 0.0, 0.08])
    for _ in range(_ITERATIONS):
        error = residual(unknown)
        if np.abs(error).max() < _TOLERANCE:
            break
        jacobian = np.column_stack(
            [(residual(unknown + step) - error) / _STEP for step in _STEP * np.eye(3)]
        )
        unknown -= np.clip(np.linalg.solve(jacobian, error), -0.2, 0.2)
    else:
        raise StandError(
            f"cannot stand with the CoM {com_height} m above the soles and the feet {width} m "
            f"apart: residual {np.abs(error).max():.3g} m after {_ITERATIONS} iterations; "
            "expected a CoM height of about 0.55 to 0.75 m"
        )
    soles = [data.geom_xpos[foot][2] - model.geom_size[foot][2] for foot in addresses.feet]
    data.qpos[2] -= min(soles)
    return np.array(data.qpos)


def standing_torque(model: Any, addresses: Addresses, qpos: Array) -> Array:
    """Return the joint torques (27,) that hold ``qpos`` at rest on both feet [N·m].

    The contact wrenches are the smallest ones (least squares) that balance the base; the joints
    carry the rest of gravity. The two halves of a knee get the mean of their torques.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_forward(model, data)
    jacobian = np.zeros((12, model.nv))
    for row, side in ((0, "left"), (6, "right")):
        site = model.site(FOOT_FRAMES[side]).id
        mujoco.mj_jacSite(model, data, jacobian[row : row + 3], jacobian[row + 3 : row + 6], site)
    base = model.joint(BASE_JOINT).dofadr[0]
    gravity = np.array(data.qfrc_bias)
    wrenches, *_ = np.linalg.lstsq(
        jacobian[:, base : base + 6].T, gravity[base : base + 6], rcond=None
    )
    joints: Array = (gravity - jacobian.T @ wrenches)[addresses.qvel]
    return MOTOR_TO_JOINT @ (JOINT_TO_MOTOR @ joints)
