"""Geometry of the robot's stereo pair, read from its MJCF."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from math import radians, tan
from xml.etree import ElementTree

import numpy as np

from common.robot.frames import BODY_FRAME, CAMERAS, HEAD_FRAME
from common.robot.joints import MJCF_PATH
from common.robot.pose import Pose
from common.robot.rotations import (
    multiply,
    quaternion_from_rotation_vector,
    quaternion_from_rpy,
    rotation_vector_from_matrix,
)
from common.schemas.arrays import Float64Array as Array


@dataclass(frozen=True)
class PinholeCamera:
    """A camera without distortion, fixed to a body of the robot.

    Attributes:
        parent: the body.
        position: of the camera in the parent's frame [m].
        quaternion: (w, x, y, z) of the optical axes in the parent's frame: x right in the picture,
            y down, z into it.
        fovy_deg: vertical field of view [deg].
    """

    parent: str
    position: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]
    fovy_deg: float

    def matrix(self, original: tuple[int, int], shown: tuple[int, int] | None = None) -> Array:
        """Return the camera matrix (3, 3) [pixels]; the centre of the first pixel is (0, 0).

        Args:
            original: width and height at which pictures are rendered, with square pixels.
            shown: width and height to which they are scaled afterwards; None: they are not.
        """
        width, height = shown or original
        focal = 0.5 / tan(radians(self.fovy_deg) / 2.0) * original[1]
        across, down = focal * width / original[0], focal * height / original[1]
        centre_x, centre_y = (width - 1) / 2.0, (height - 1) / 2.0
        return np.array([[across, 0.0, centre_x], [0.0, down, centre_y], [0.0, 0.0, 1.0]])


@cache
def stereo_pair() -> Mapping[str, PinholeCamera]:
    """Return the cameras by side."""
    root = ElementTree.parse(MJCF_PATH).getroot()
    found = {
        camera.get("name", ""): (body.get("name", ""), camera)
        for body in root.iter("body")
        for camera in body.findall("camera")
    }
    return {side: _camera(*found[name]) for side, name in CAMERAS.items()}


def camera_in_body(side: str, neck_pitch: float) -> Pose:
    """Return the pose of a camera's optical axes in the body frame: x right, y down, z ahead.

    Args:
        side: ``left`` or ``right``.
        neck_pitch: position of the neck's joint; positive looks down [rad].
    """
    camera = stereo_pair()[side]
    head = Pose(np.array(_head_position()), quaternion_from_rpy(0.0, neck_pitch, 0.0))
    mounted = np.array(camera.quaternion)
    return Pose(head.apply(np.array(camera.position)), multiply(head.quaternion, mounted))


@cache
def _head_position() -> tuple[float, ...]:
    """Return the position (3,) of the head, on which the cameras are, in the body frame [m]."""
    root = ElementTree.parse(MJCF_PATH).getroot()
    head = root.find(f".//body[@name='{BODY_FRAME}']/body[@name='{HEAD_FRAME}']")
    if head is None or head.get("quat") is not None:
        raise ValueError(f"expected {HEAD_FRAME} on {BODY_FRAME}, unrotated, in {MJCF_PATH.name}")
    return tuple(float(text) for text in head.attrib["pos"].split())


def _camera(parent: str, element: ElementTree.Element) -> PinholeCamera:
    x, y, z = (float(text) for text in element.attrib["pos"].split())
    axes = np.array([float(text) for text in element.attrib["xyaxes"].split()])
    right, up = axes[:3], axes[3:]
    optical = np.stack([right, -up, np.cross(up, right)], axis=1)
    quaternion = quaternion_from_rotation_vector(rotation_vector_from_matrix(optical))
    # Rounded, since the camera stands in files whose bytes are compared.
    w, i, j, k = (float(part) for part in np.round(quaternion, 12))
    return PinholeCamera(parent, (x, y, z), (w, i, j, k), float(element.attrib["fovy"]))
