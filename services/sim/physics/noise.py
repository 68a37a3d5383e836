"""White Gaussian noise on a measured state."""

import numpy as np

from common.robot.rotations import multiply, normalised, quaternion_from_rotation_vector
from common.schemas import PlantState
from services.sim.config import NoiseConfig


def add_noise(state: PlantState, noise: NoiseConfig, rng: np.random.Generator) -> PlantState:
    """Return a copy of ``state`` with white noise of these standard deviations."""
    joints = state.joint_position.size
    return state.model_copy(
        update={
            "base_position": state.base_position + rng.normal(0.0, noise.position, 3),
            # A factor on the right rotates about the body's own axes.
            "base_quaternion": normalised(
                multiply(
                    state.base_quaternion,
                    quaternion_from_rotation_vector(rng.normal(0.0, noise.orientation, 3)),
                )
            ),
            "base_linear_velocity": state.base_linear_velocity + rng.normal(0.0, noise.velocity, 3),
            "base_angular_velocity": state.base_angular_velocity
            + rng.normal(0.0, noise.angular_velocity, 3),
            "joint_position": state.joint_position + rng.normal(0.0, noise.joint_position, joints),
            "joint_velocity": state.joint_velocity + rng.normal(0.0, noise.joint_velocity, joints),
        }
    )
