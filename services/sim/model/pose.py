"""Putting a recorded or received state into MuJoCo, for pictures only: no dynamics."""

from typing import Any

import mujoco

from common.robot.joints import GRIPPER_STROKE
from common.schemas import PlantState, SceneState
from services.sim.errors import SceneError
from services.sim.model.world import Addresses


def show_state(
    model: Any,
    data: Any,
    addresses: Addresses,
    state: PlantState,
    objects: SceneState | None = None,
) -> None:
    """Place robot, lights and cameras of ``data`` as in ``state``, the scene as in ``objects``.

    Without ``objects`` the scene stays where it is.

    Raises:
        SceneError: ``objects`` are of another scene than the model.
    """
    if objects is not None:
        places = data.qpos[addresses.scene :]
        if len(objects.qpos) != places.size:
            raise SceneError(
                f"cannot show the scene {objects.scene!r}: expected {places.size} joint values, "
                f"as the model of these pictures has, got {len(objects.qpos)}; name the same "
                "scene or task for plant and pictures"
            )
        places[:] = objects.qpos
    data.qpos[:3] = state.base_position
    data.qpos[3:7] = state.base_quaternion
    data.qpos[addresses.qpos] = state.joint_position
    data.qpos[addresses.fingers_qpos] = GRIPPER_STROKE * (1.0 - state.gripper_closure[:, None])
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
