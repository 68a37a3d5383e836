"""White Gaussian noise on a measured state."""

import numpy as np
from numpy.typing import NDArray

from common.schemas import PlantState
from services.sim.config import NoiseConfig

Array = NDArray[np.float64]


def rotate_by(quaternion: Array, rotation_vector: Array) -> Array:
    """(4,) unit quaternion (w, x, y, z) followed by the small body-frame rotation [rad]."""
    angle = float(np.linalg.norm(rotation_vector))
    if angle == 0.0:
        return quaternion
    axis = rotation_vector * (np.sin(0.5 * angle) / angle)
    w, v = quaternion[0], quaternion[1:]
    c = np.cos(0.5 * angle)
    rotated = np.concatenate(([w * c - v @ axis], w * axis + c * v + np.cross(v, axis)))
    return rotated / float(np.linalg.norm(rotated))


def add_noise(state: PlantState, noise: NoiseConfig, rng: np.random.Generator) -> PlantState:
    """Return ``state`` as a sensor of this quality would report it."""
    joints = state.joint_position.size
    return state.model_copy(
        update={
            "base_position": state.base_position + rng.normal(0.0, noise.position, 3),
            "base_quaternion": rotate_by(
                state.base_quaternion, rng.normal(0.0, noise.orientation, 3)
            ),
            "base_linear_velocity": state.base_linear_velocity + rng.normal(0.0, noise.velocity, 3),
            "base_angular_velocity": state.base_angular_velocity
            + rng.normal(0.0, noise.angular_velocity, 3),
            "joint_position": state.joint_position + rng.normal(0.0, noise.joint_position, joints),
            "joint_velocity": state.joint_velocity + rng.normal(0.0, noise.joint_velocity, joints),
        }
    )
