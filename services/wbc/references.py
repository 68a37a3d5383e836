"""References of frames and of the whole body at one instant."""

from typing import NamedTuple

import numpy as np

from common.robot.rotations import matrix_from_yaw
from common.schemas.arrays import Float64Array as Array

UNLOADED = 1e-3
"""Normal force limit of an unloaded foot [N]."""


class PoseReference(NamedTuple):
    """Desired pose and motion of a frame, in world or in the body frame.

    Attributes:
        position: (3,) [m].
        rotation: (3, 3).
        velocity: (6,) linear, angular [m/s, rad/s].
        acceleration: (6,) linear, angular [m/s², rad/s²].
    """

    position: Array
    rotation: Array
    velocity: Array
    acceleration: Array


class Heading(NamedTuple):
    """Reference of an upright torso.

    Attributes:
        rotation: (3, 3) torso_link to world.
        rate: (3,) angular velocity in world [rad/s].
        acceleration: (3,) likewise [rad/s²].
    """

    rotation: Array
    rate: Array
    acceleration: Array


SwingPair = tuple[PoseReference | None, PoseReference | None]
"""Reference of the left and the right foot while it swings; None for a stance foot."""


class BodyReference(NamedTuple):
    """References of CoM, torso and feet in world.

    Attributes:
        com: (3,) [m].
        com_velocity: (3,) [m/s].
        com_acceleration: (3,) [m/s²].
        dcm: (2,) planned [m].
        torso: of torso_link.
        swing: references of swinging feet.
        normal_force_max: limit for the left and the right foot [N].
        load: scheduled load of the left and the right foot, 0 (in the air) to 1.
    """

    com: Array
    com_velocity: Array
    com_acceleration: Array
    dcm: Array
    torso: Heading
    swing: SwingPair
    normal_force_max: tuple[float, float]
    load: tuple[float, float]


_AT_REST = np.zeros(3)


def heading(yaw: float, rate: float = 0.0, acceleration: float = 0.0) -> Heading:
    """Return the reference of an upright torso with a heading [rad, rad/s, rad/s²]."""
    rotation = matrix_from_yaw(yaw)
    if rate == acceleration == 0.0:
        return Heading(rotation, _AT_REST, _AT_REST)
    return Heading(rotation, np.array([0.0, 0.0, rate]), np.array([0.0, 0.0, acceleration]))


def force_limits(load: tuple[float, float], full: float) -> tuple[float, float]:
    """Return the normal force limits of both feet; ``full`` is that of a loaded foot [N]."""
    return max(UNLOADED, load[0] * full), max(UNLOADED, load[1] * full)
