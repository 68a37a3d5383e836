"""Where the hands are, seen from the torso: forward kinematics of the arms from the MJCF alone."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from functools import cache

import numpy as np

from common.robot.frames import BODY_FRAME, HAND_FRAMES
from common.robot.joints import JOINT_INDEX, MJCF_PATH
from common.robot.rotations import multiply, quaternion_from_rotation_vector, rotate_vector
from common.schemas.arrays import Float64Array as Array
from services.teleop.errors import TeleopError


@dataclass(frozen=True)
class _Link:
    """A body on the way to the hand; ``joint`` indexes the 27 joints, -1 for a rigid one."""

    position: Array
    quaternion: Array
    axis: Array
    joint: int


def _numbers(element: ET.Element, name: str, default: str) -> Array:
    return np.array([float(text) for text in element.get(name, default).split()])


def _path_to(element: ET.Element, site: str) -> list[ET.Element]:
    """Elements from below ``element`` to the site; empty if it is not there."""
    for child in element:
        if child.tag == "site" and child.get("name") == site:
            return [child]
        if child.tag == "body":
            rest = _path_to(child, site)
            if rest:
                return [child, *rest]
    return []


def _link(element: ET.Element) -> _Link:
    joint = element.find("joint")
    name = "" if joint is None else joint.get("name", "")
    return _Link(
        _numbers(element, "pos", "0 0 0"),
        _numbers(element, "quat", "1 0 0 0"),
        np.zeros(3) if joint is None else _numbers(joint, "axis", "0 0 1"),
        JOINT_INDEX.get(name, -1),
    )


@cache
def _chain(side: str) -> tuple[_Link, ...]:
    torso = ET.parse(MJCF_PATH).getroot().find(f".//body[@name='{BODY_FRAME}']")
    path = [] if torso is None else _path_to(torso, HAND_FRAMES[side])
    if not path:
        raise TeleopError(f"expected a site {HAND_FRAMES[side]!r} below {BODY_FRAME!r} in the MJCF")
    return tuple(_link(element) for element in path)


def hand_in_body(side: str, joints: Array) -> tuple[Array, Array]:
    """Pose of a hand in the body frame.

    Args:
        side: ``left`` or ``right``.
        joints: (27,) positions [rad].

    Returns:
        position (3,) [m] and quaternion (4,), hand to body.
    """
    position, quaternion = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    for link in _chain(side):
        position = position + rotate_vector(quaternion, link.position)
        quaternion = multiply(quaternion, link.quaternion)
        if link.joint >= 0:
            turn = quaternion_from_rotation_vector(float(joints[link.joint]) * link.axis)
            quaternion = multiply(quaternion, turn)
    return position, quaternion
