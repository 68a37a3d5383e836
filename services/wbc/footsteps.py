"""Footsteps of the six gaits: two steps that displace the stance."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from common.robot.rotations import matrix_from_yaw, wrap_angle
from common.schemas import Gait
from common.schemas.arrays import Float64Array as Array
from services.wbc.config import GaitConfig

Side = Literal[0, 1]
"""0 left, 1 right."""


@dataclass(frozen=True)
class Stance:
    """Horizontal pose midway between the feet, in world.

    Attributes:
        position: (2,) [m].
        yaw: heading [rad].
    """

    position: Array
    yaw: float

    def moved(self, forward: float, left: float, turn: float) -> "Stance":
        """Return the stance displaced in its own frame [m] and then turned [rad]."""
        offset = matrix_from_yaw(self.yaw)[:2, :2] @ np.array([forward, left])
        return Stance(self.position + offset, wrap_angle(self.yaw + turn))

    def foot(self, side: Side, width: float) -> "Footprint":
        """Return the footprint of one foot, ``width`` [m] from the other."""
        offset = 0.5 * width * (1.0 if side == 0 else -1.0)
        shifted = self.moved(0.0, offset, 0.0)
        return Footprint(side, shifted.position, self.yaw)


@dataclass(frozen=True)
class Footprint:
    """Horizontal pose of one sole, in world.

    Attributes:
        side: 0 left, 1 right.
        position: (2,) [m].
        yaw: heading [rad].
    """

    side: Side
    position: Array
    yaw: float


def stance_between(left: Footprint, right: Footprint) -> Stance:
    """Return the stance of two feet."""
    yaw = right.yaw + 0.5 * wrap_angle(left.yaw - right.yaw)
    return Stance(0.5 * (left.position + right.position), wrap_angle(yaw))


_FIRST_FOOT: dict[Gait, Side] = {
    Gait.FORWARD: 0,
    Gait.BACKWARD: 0,
    Gait.SIDE_LEFT: 0,
    Gait.SIDE_RIGHT: 1,
    Gait.TURN_LEFT: 0,
    Gait.TURN_RIGHT: 1,
}


def gait_displacement(gait: Gait, config: GaitConfig) -> tuple[float, float, float]:
    """Return the commanded motion of a gait in the stance frame: forward, left [m], turn [rad]."""
    return {
        Gait.NONE: (0.0, 0.0, 0.0),
        Gait.FORWARD: (config.forward_step, 0.0, 0.0),
        Gait.BACKWARD: (-config.backward_step, 0.0, 0.0),
        Gait.SIDE_LEFT: (0.0, config.side_step, 0.0),
        Gait.SIDE_RIGHT: (0.0, -config.side_step, 0.0),
        Gait.TURN_LEFT: (0.0, 0.0, config.turn_angle),
        Gait.TURN_RIGHT: (0.0, 0.0, -config.turn_angle),
    }[gait]


def plan_footsteps(gait: Gait, stance: Stance, config: GaitConfig) -> list[Footprint]:
    """Return the two footprints of a gait in stepping order, both of the displaced stance.

    In side-steps and turns the foot on the side of the motion steps first, so that the feet never
    cross; forward and backward the left foot leads, as in the public TRILL code.

    Raises:
        ValueError: ``gait`` is NONE.
    """
    if gait is Gait.NONE:
        raise ValueError("Gait.NONE has no footsteps; expected one of the six gaits")
    target = stance.moved(*gait_displacement(gait, config))
    first = _FIRST_FOOT[gait]
    second: Side = 1 if first == 0 else 0
    return [target.foot(first, config.stance_width), target.foot(second, config.stance_width)]
