"""Change of coordinates between the two libraries, and joint setting by name."""

from collections.abc import Mapping
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def set_joints(model: Any, data: Any, positions: Mapping[str, float]) -> None:
    for name, value in positions.items():
        data.qpos[model.joint(name).qposadr[0]] = value


def pin_configuration(qpos: Array) -> Array:
    """MuJoCo's (w, x, y, z) becomes pinocchio's (x, y, z, w)."""
    q = qpos.copy()
    q[3:7] = qpos[[4, 5, 6, 3]]
    return q


def base_rotation(qpos: Array) -> Array:
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, qpos[3:7])
    return rotation.reshape(3, 3)


def body_from_pin(rotation: Array, nv: int) -> Array:
    """T with v_mujoco = T v_pin: MuJoCo's base velocity is linear in world, angular in body."""
    transform = np.eye(nv)
    transform[:3, :3] = rotation
    return transform
