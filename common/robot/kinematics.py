"""Kinematics of feet and hands in the body frame, from the MJCF alone.

It needs numpy and the standard library only, so that whoever records demonstrations, shows a
picture or runs a policy computes these poses alike, without a dynamics library.
"""

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from functools import cache
from math import cos, sin

import numpy as np

from common.errors import TrillError
from common.robot.frames import BODY_FRAME, FOOT_FRAMES, FORWARD_HAND_IN_BODY, HAND_FRAMES
from common.robot.joints import (
    JOINT_INDEX,
    LEFT_LEG,
    MJCF_PATH,
    MOTOR_TO_JOINT,
    POSITION_LOWER,
    POSITION_UPPER,
    RIGHT_LEG,
)
from common.robot.pose import Pose
from common.robot.rotations import (
    multiplied,
    nearer_sign,
    normalised,
    rotated,
    rotation_between,
)
from common.schemas.arrays import Float64Array as Array

_IDENTITY = (1.0, 0.0, 0.0, 0.0)
_LEG = {"left": LEFT_LEG, "right": RIGHT_LEG}
_ITERATIONS = 5
"""Of Newton's method for a leg; from 5 cm away the fourth is exact to 0.1 mm."""
_DAMPING = 1e-6
"""Added to J J' [m²], so that a stretched leg moves no further than it can."""
FLAT_FOOT = np.array(_IDENTITY)
FORWARD_HAND = np.array(FORWARD_HAND_IN_BODY)
"""Of the two quaternions of an orientation, recorded vectors hold the one nearer to these."""


class KinematicsError(TrillError):
    """The robot's description is not one that this module can read."""


@dataclass(frozen=True, slots=True)
class _Link:
    """A body on the way to an end effector, or the end effector's site itself.

    Attributes:
        position: in the parent [m].
        quaternion: to the parent; None: not rotated.
        joint: index among the 27 joints; -1: fixed to its parent.
        axis: of the joint in the link; unused if fixed.
    """

    position: tuple[float, ...]
    quaternion: tuple[float, ...] | None
    joint: int
    axis: tuple[float, ...]


def foot_in_body(side: str, joint_position: Array) -> Pose:
    """Return the pose of a sole in the body frame.

    Args:
        side: ``left`` or ``right``.
        joint_position: (27,) [rad].
    """
    return _site_in_body(FOOT_FRAMES[side], joint_position)


def hand_in_body(side: str, joint_position: Array) -> Pose:
    """Return the pose of a hand in the body frame.

    Args:
        side: ``left`` or ``right``.
        joint_position: (27,) [rad].
    """
    return _site_in_body(HAND_FRAMES[side], joint_position)


def end_effector_poses(joint_position: Array) -> Array:
    """Return the poses of left foot, right foot, left hand and right hand in the body frame.

    Args:
        joint_position: (27,) [rad].

    Returns:
        (28,): for each the position [m], then the quaternion (w, x, y, z) with the sign that is
        nearer to a flat foot's or to a hand's that points ahead.
    """
    parts: list[Array] = []
    for frames, usual in ((FOOT_FRAMES, FLAT_FOOT), (HAND_FRAMES, FORWARD_HAND)):
        for side in ("left", "right"):
            pose = _site_in_body(frames[side], joint_position)
            parts += [pose.position, nearer_sign(pose.quaternion, usual)]
    return np.concatenate(parts)


def leg_reaching(side: str, goal: Pose, joint_position: Array) -> Array:
    """Return joint positions (27,) whose sole is at a pose in the body frame, or near it.

    Within the joints' limits, by Newton's method from ``joint_position``; only this leg moves. A
    goal out of reach is approached: whoever needs it exactly compares :func:`foot_in_body`.

    Args:
        side: ``left`` or ``right``.
        goal: of the sole in the body frame.
        joint_position: (27,) where to start [rad].
    """
    reached, leg = joint_position.copy(), _LEG[side]
    low, high, motors = POSITION_LOWER[leg], POSITION_UPPER[leg], MOTOR_TO_JOINT[leg]
    for _ in range(_ITERATIONS):
        turns: list[tuple[int, Array, Array]] = []
        pose = _site_in_body(FOOT_FRAMES[side], reached, turns)
        jacobian = np.zeros((6, leg.stop - leg.start))
        for joint, origin, axis in turns:
            lever = np.cross(axis, pose.position - origin)
            jacobian[:, joint - leg.start] = *lever, *axis
        to_motors = jacobian @ motors
        error = np.concatenate(
            (goal.position - pose.position, rotation_between(pose.quaternion, goal.quaternion))
        )
        square = to_motors @ to_motors.T + _DAMPING * np.eye(6)
        step = motors @ (to_motors.T @ np.linalg.solve(square, error))
        reached[leg] = np.clip(reached[leg] + step, low, high)
    return reached


def _site_in_body(
    site: str, joint_position: Array, turns: list[tuple[int, Array, Array]] | None = None
) -> Pose:
    """Return the pose of a site; ``turns`` gets index, origin and axis of each joint before it."""
    # In plain numbers: an operator and a recorder ask for several poses twenty times a second.
    x = y = z = 0.0
    quaternion = _IDENTITY
    angles = joint_position.tolist()
    for link in _chain(site):
        dx, dy, dz = rotated(quaternion, link.position)
        x, y, z = x + dx, y + dy, z + dz
        if link.quaternion is not None:
            quaternion = multiplied(quaternion, link.quaternion)
        if link.joint >= 0:
            if turns is not None:
                axis = np.array(rotated(quaternion, link.axis))
                turns.append((link.joint, np.array([x, y, z]), axis))
            half = 0.5 * angles[link.joint]
            s, (a, b, c) = sin(half), link.axis
            quaternion = multiplied(quaternion, (cos(half), s * a, s * b, s * c))
    return Pose(np.array([x, y, z]), np.array(quaternion))


@cache
def _chain(site: str) -> tuple[_Link, ...]:
    torso = ET.parse(MJCF_PATH).getroot().find(f".//body[@name='{BODY_FRAME}']")
    path = [] if torso is None else _path_to(torso, site)
    if not path:
        raise KinematicsError(f"expected a site {site!r} below {BODY_FRAME!r} in {MJCF_PATH.name}")
    return tuple(_link(element) for element in path)


def _path_to(element: ET.Element, site: str) -> list[ET.Element]:
    """Return the elements from below ``element`` down to the site; empty if it is not there."""
    for child in element:
        if child.tag == "site" and child.get("name") == site:
            return [child]
        if child.tag == "body" and (rest := _path_to(child, site)):
            return [child, *rest]
    return []


def _link(element: ET.Element) -> _Link:
    joints = element.findall("joint")
    names = [joint.get("name", "") for joint in joints]
    if len(names) > 1 or not set(names) <= set(JOINT_INDEX) or any(j.get("pos") for j in joints):
        raise KinematicsError(
            f"expected at most one of the robot's joints, at the origin of {element.get('name')!r} "
            f"in {MJCF_PATH.name}, got {names}"
        )
    quaternion = _numbers(element, "quat", "1 0 0 0")
    return _Link(
        _numbers(element, "pos", "0 0 0"),
        None if quaternion == _IDENTITY else tuple(normalised(np.array(quaternion)).tolist()),
        JOINT_INDEX[names[0]] if names else -1,
        _numbers(joints[0], "axis", "0 0 1") if joints else (0.0, 0.0, 0.0),
    )


def _numbers(element: ET.Element, name: str, default: str) -> tuple[float, ...]:
    return tuple(float(text) for text in element.get(name, default).split())
