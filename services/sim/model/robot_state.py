"""Conversion between state messages and MuJoCo: gripper closure, and states shown in pictures."""

from typing import Any, Final

import mujoco

from common.robot.joints import GRIPPER_CLOSE_COMMAND, GRIPPER_STROKE
from common.schemas import PlantState, SceneState
from services.sim.errors import SceneError
from services.sim.model.world import Addresses

SQUEEZE_FROM: Final = 0.9
"""Closure from which on the command runs ahead of the jaw, up to the full grip force at 1."""


def jaw_command(closure: float) -> float:
    """Return the finger position to command [m] for a closure, which is clipped to 0..1.

    Below :data:`SQUEEZE_FROM` it is the position itself, so that a half-closed command leaves
    a half-closed hand; above, it goes past contact so that the position servo squeezes.

    Args:
        closure: 0 open to 1 closed.
    """
    closed = min(max(closure, 0.0), 1.0)
    squeeze = max(closed - SQUEEZE_FROM, 0.0) / (1.0 - SQUEEZE_FROM)
    return GRIPPER_STROKE * (1.0 - closed) + GRIPPER_CLOSE_COMMAND * squeeze


def jaw_closure(finger: float) -> float:
    """Return the closure 0..1 of a finger's position [m]."""
    return min(max(1.0 - finger / GRIPPER_STROKE, 0.0), 1.0)


def show_state(
    model: Any,
    data: Any,
    addresses: Addresses,
    state: PlantState,
    objects: SceneState | None = None,
) -> None:
    """Set robot and scene of ``data`` to received states, for pictures: kinematics, no dynamics.

    Args:
        model: the ``mujoco.MjModel``.
        data: its ``mujoco.MjData``.
        addresses: of the robot in the model.
        state: of the robot.
        objects: state of the scene; None: the scene stays as it is.

    Raises:
        SceneError: ``objects`` belong to another scene than the model.
    """
    if objects is not None:
        scene_qpos = data.qpos[addresses.scene :]
        if len(objects.qpos) != scene_qpos.size:
            raise SceneError(
                f"cannot show the scene {objects.scene!r}: expected {scene_qpos.size} joint values "
                f"for this model, got {len(objects.qpos)}; use the same scene or task for plant "
                "and pictures"
            )
        scene_qpos[:] = objects.qpos
    data.qpos[:3] = state.base_position
    data.qpos[3:7] = state.base_quaternion
    data.qpos[addresses.qpos] = state.joint_position
    data.qpos[addresses.fingers_qpos] = GRIPPER_STROKE * (1.0 - state.gripper_closure[:, None])
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
