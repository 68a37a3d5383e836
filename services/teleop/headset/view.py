"""Hands in the robot's pictures: where they are seen, and where a drag puts them; pure."""

from dataclasses import dataclass
from math import radians, tan

import numpy as np

from common.robot.cameras import camera_in_body
from common.robot.frames import CAMERA_FOVY_DEG
from common.robot.rotations import rotate_vector
from common.robot.workspace import clamp_to_workspace
from common.schemas.arrays import Float64Array as Array

FOCAL_LENGTH = 0.5 / tan(radians(CAMERA_FOVY_DEG) / 2.0)
"""Of both cameras, in heights of the picture."""
NEAREST = 0.05
"""Smallest distance ahead of the camera at which a hand is seen [m]."""


def seen_from(side: str, neck_pitch: float, point: Array) -> Array:
    """Return a point of the body frame in a camera's axes: x right, y down, z ahead.

    Args:
        side: of the camera, ``left`` or ``right``.
        neck_pitch: [rad].
        point: (3,) in the body frame [m].
    """
    return camera_in_body(side, neck_pitch).local(point)


def in_picture(seen: Array) -> tuple[float, float] | None:
    """Return where a point is in the picture; None: behind the camera.

    Args:
        seen: (3,) point in the camera's axes [m].

    Returns:
        to the right and down from the centre, in heights of the picture.
    """
    x, y, z = seen.tolist()
    if z < NEAREST:
        return None
    return FOCAL_LENGTH * x / z, FOCAL_LENGTH * y / z


@dataclass(frozen=True)
class DragStart:
    """A drag that has just begun.

    The hand moves in the plane that was parallel to the picture when the drag began, so that it
    stays under the pointer.

    Attributes:
        side: of the hand.
        position: (3,) of the hand's goal in the body frame [m].
        neck_pitch: [rad].
        offset: (3,) way of the drag before the hand could follow.
    """

    side: str
    position: Array
    neck_pitch: float
    offset: Array

    def goal(self, way: Array) -> Array:
        """Return the goal (3,) of the hand in the body frame, within the workspace [m].

        Args:
            way: (3,) of the drag since it began: right and down in heights of the picture, and
                ahead [m].
        """
        camera = camera_in_body("left", self.neck_pitch)
        depth = max(float(camera.local(self.position)[2]), NEAREST)
        scale = np.array([depth / FOCAL_LENGTH, depth / FOCAL_LENGTH, 1.0])
        moved = rotate_vector(camera.quaternion, scale * (way - self.offset))
        return clamp_to_workspace(self.side, self.position + moved)
