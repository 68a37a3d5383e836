"""Putting a recorded or received state into MuJoCo, for pictures only: no dynamics."""

from typing import Any

import mujoco

from common.robot.joints import GRIPPER_STROKE
from common.schemas import PlantState
from services.sim.world import Addresses


def show_state(model: Any, data: Any, addresses: Addresses, state: PlantState) -> None:
    """Place robot, lights and cameras of ``data`` as in ``state``; the rest stays where it is."""
    data.qpos[:3] = state.base_position
    data.qpos[3:7] = state.base_quaternion
    data.qpos[addresses.qpos] = state.joint_position
    data.qpos[addresses.fingers_qpos] = GRIPPER_STROKE * (1.0 - state.gripper_closure[:, None])
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
