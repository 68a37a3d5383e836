"""White Gaussian noise on a measured state."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from common.robot.joints import NUM_JOINTS
from common.robot.rotations import multiply, normalised, quaternion_from_rotation_vector
from common.schemas import PlantState
from common.schemas.arrays import Float64Array as Array
from common.wire.builder import assembler
from services.sim.config import NoiseConfig

_assemble: Callable[[dict[str, Any]], PlantState] = assembler(PlantState)
_JOINT_POSITION, _JOINT_VELOCITY = 12, 12 + NUM_JOINTS


@cache
def _deviations(noise: NoiseConfig) -> Array:
    """Return the standard deviation of every number drawn for a state, in the order drawn."""
    return np.repeat(
        (
            noise.position,
            noise.orientation,
            noise.velocity,
            noise.angular_velocity,
            noise.joint_position,
            noise.joint_velocity,
        ),
        (3, 3, 3, 3, NUM_JOINTS, NUM_JOINTS),
    )


def add_noise(state: PlantState, noise: NoiseConfig, rng: np.random.Generator) -> PlantState:
    """Return a copy of ``state`` with white noise of these standard deviations."""
    deviations = _deviations(noise)
    drawn = deviations * rng.standard_normal(deviations.size)
    # A factor on the right rotates about the body's own axes.
    turned = multiply(state.base_quaternion, quaternion_from_rotation_vector(drawn[3:6]))
    return _assemble(
        {
            **state.__dict__,
            "base_position": state.base_position + drawn[:3],
            "base_quaternion": normalised(turned),
            "base_linear_velocity": state.base_linear_velocity + drawn[6:9],
            "base_angular_velocity": state.base_angular_velocity + drawn[9:12],
            "joint_position": state.joint_position + drawn[_JOINT_POSITION:_JOINT_VELOCITY],
            "joint_velocity": state.joint_velocity + drawn[_JOINT_VELOCITY:],
        }
    )
