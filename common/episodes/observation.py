"""Turns messages into the observation and action vectors of one frame of an episode.

Collecting, recording people, training and serving a policy share these functions, so that a policy
sees in service what it was trained on.
"""

import numpy as np

from common.robot.kinematics import FORWARD_HAND, end_effector_poses
from common.robot.rotations import nearer_sign
from common.robot.workspace import clamp_to_workspace
from common.schemas import ControllerState, PlantState, SceneState, Setpoint
from common.schemas.arrays import Float64Array as Array

Frame = dict[str, object]
"""Values of one frame by the path of their column, see :mod:`common.episodes.columns`."""


def observation(state: PlantState, controller: ControllerState) -> Frame:
    """Return the ``observation/`` columns: what the robot measured and the controller's state.

    Poses of feet and hands are (position [m], quaternion (w, x, y, z)) in the body frame, by
    forward kinematics from the measured joints.
    """
    q = state.joint_position
    return {
        "observation/poses": end_effector_poses(q),
        "observation/control_state": int(controller.state),
        "observation/joint_sin_cos": np.concatenate((np.sin(q), np.cos(q))),
        "observation/joint_velocity": state.joint_velocity,
        "observation/gripper_closure": state.gripper_closure,
        "observation/hand_error": np.concatenate(
            (controller.hand_position_error, controller.hand_rotation_error)
        ),
    }


def action(setpoint: Setpoint) -> Frame:
    """Return the ``action/`` columns: the set-points of hands [m], grippers and neck [rad].

    Hand positions are clamped to the workspace, as the controller does. Hand quaternions get the
    sign nearer to the usual orientation of a hand, so that they do not jump. ``action/locomotion``
    is 0: no gait is requested.
    """
    hands: list[Array] = [
        clamp_to_workspace("left", setpoint.left_hand_position_in_body),
        nearer_sign(setpoint.left_hand_quaternion_in_body, FORWARD_HAND),
        clamp_to_workspace("right", setpoint.right_hand_position_in_body),
        nearer_sign(setpoint.right_hand_quaternion_in_body, FORWARD_HAND),
    ]
    return {
        "action/hands": np.concatenate(hands),
        "action/grasp": setpoint.gripper_closure,
        "action/locomotion": 0,
        "action/neck": setpoint.neck_pitch,
    }


def truth(state: PlantState, scene: SceneState) -> Frame:
    """Return the ``truth/`` columns: exact poses of robot and scene, for scoring and rendering."""
    return {
        "truth/base_position": state.base_position,
        "truth/base_quaternion": state.base_quaternion,
        "truth/joint_position": state.joint_position,
        "truth/gripper_closure": state.gripper_closure,
        "truth/scene_qpos": np.array(scene.qpos),
    }


def times(now_ns: int, **stamps_ns: int) -> Frame:
    """Return the ``time/`` and ``age/`` columns of a frame at robot time ``now_ns``.

    Args:
        now_ns: when the action was given [ns].
        stamps_ns: robot times of what the frame holds, by name: ``state``, ``controller``,
            ``picture``, ``truth``, ``seen`` [ns].
    """
    frame: Frame = {"time/robot_ns": now_ns}
    frame |= {f"time/{name}_ns": stamp for name, stamp in stamps_ns.items()}
    return frame | {f"age/{name}": (now_ns - stamp) * 1e-9 for name, stamp in stamps_ns.items()}
