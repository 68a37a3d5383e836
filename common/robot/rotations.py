"""Unit quaternions (w, x, y, z): the few operations that hand targets need."""

import math

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def normalised(quaternion: Array) -> Array:
    """``quaternion`` (4,) scaled to norm one; its norm must not be zero."""
    return quaternion / np.linalg.norm(quaternion)


def multiply(a: Array, b: Array) -> Array:
    """Hamilton product (4,): the rotation ``b`` followed by ``a``, both about parent axes."""
    aw, ax, ay, az = a.tolist()
    bw, bx, by, bz = b.tolist()
    return np.array(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ]
    )


def from_rotation_vector(vector: Array) -> Array:
    """Quaternion (4,) of the rotation by ``|vector|`` rad about ``vector`` (3,)."""
    angle = float(np.linalg.norm(vector))
    # sinc keeps the small-angle limit exact: sin(a/2)/a = sinc(a/2pi)/2.
    return np.concatenate([[math.cos(angle / 2)], 0.5 * np.sinc(angle / (2 * math.pi)) * vector])


def rotation_vector(start: Array, end: Array) -> Array:
    """Shortest rotation (3,) [rad] about parent axes that turns ``start`` into ``end``."""
    w, *vector = multiply(end, start * np.array([1.0, -1.0, -1.0, -1.0]))
    xyz = np.array(vector)
    sine = float(np.linalg.norm(xyz))
    if sine == 0.0:
        return np.zeros(3)
    angle = 2.0 * math.atan2(sine, abs(w))
    return (math.copysign(angle, w) / sine) * xyz


def from_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Quaternion (4,) of Rz(yaw) Ry(pitch) Rx(roll): turns about fixed x, then y, then z [rad]."""
    axes = np.eye(3)
    turned = multiply(from_rotation_vector(pitch * axes[1]), from_rotation_vector(roll * axes[0]))
    return multiply(from_rotation_vector(yaw * axes[2]), turned)


def rotate(start: Array, rotation: Array) -> Array:
    """``start`` (4,) turned by the rotation vector ``rotation`` (3,) about parent axes [rad].

    For at most half a turn this is, of the result's two quaternions, the one nearer to ``start``,
    so a target that moves in small turns never flips sign.
    """
    return normalised(multiply(from_rotation_vector(rotation), start))


def to_rpy(quaternion: Array) -> tuple[float, float, float]:
    """Roll, pitch, yaw [rad] of a unit quaternion: the inverse of :func:`from_rpy`."""
    w, x, y, z = quaternion
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = math.asin(min(1.0, max(-1.0, 2 * (w * y - z * x))))
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return roll, pitch, yaw
