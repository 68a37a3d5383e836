"""What locomotion asks of the body at one instant."""

from typing import NamedTuple

import numpy as np

from common.robot.rotations import matrix_from_yaw
from common.schemas.arrays import Float64Array as Array
from services.wbc.swing import PoseReference

UNLOADED = 1e-3
"""Normal force left to a foot that should carry nothing [N]."""

SwingPair = tuple[PoseReference | None, PoseReference | None]
"""Per foot (left, right) the reference of its swing, or None for a stance foot."""


class BodyReference(NamedTuple):
    """References of CoM, torso and feet, in world.

    Attributes:
        com: (3,) [m].
        com_velocity: (3,) [m/s].
        com_acceleration: (3,) [m/s²].
        dcm: (2,) planned [m].
        torso: heading reference of torso_link (position unused).
        swing: references of swinging feet.
        normal_force_max: per foot [N].
        load: per foot share of the contact schedule, 0 (in the air) to 1.
    """

    com: Array
    com_velocity: Array
    com_acceleration: Array
    dcm: Array
    torso: PoseReference
    swing: SwingPair
    normal_force_max: tuple[float, float]
    load: tuple[float, float]


def heading(yaw: float, rate: float = 0.0, acceleration: float = 0.0) -> PoseReference:
    """Reference of an upright torso with this heading [rad], its rate and acceleration."""
    up = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    return PoseReference(np.zeros(3), matrix_from_yaw(yaw), rate * up, acceleration * up)


def force_limits(load: tuple[float, float], full: float) -> tuple[float, float]:
    """Upper bound of each foot's normal force [N] for a load share; ``full`` for a loaded foot."""
    return max(UNLOADED, load[0] * full), max(UNLOADED, load[1] * full)
