"""Rotations as numpy arrays: the few operations the controller needs, lean enough for its tick.

Quaternions are (w, x, y, z); rotation vectors are axis times angle [rad].
"""

from math import atan2, cos, sin, sqrt

import numpy as np

from common.schemas.arrays import Float64Array as Array


def matrix_from_quaternion(quaternion: Array) -> Array:
    """Rotation matrix (3, 3) of a quaternion (w, x, y, z), normalised first."""
    w, x, y, z = quaternion.tolist()
    s = 2.0 / (w * w + x * x + y * y + z * z)
    return np.array(
        [
            [1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)],
        ]
    )


def rotation_vector(matrix: Array) -> Array:
    """Logarithm of a rotation matrix: axis times angle in [0, pi] [rad]."""
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    x, y, z = h - f, c - g, d - b
    cosine = min(1.0, max(-1.0, 0.5 * (a + e + i - 1.0)))
    sine = 0.5 * sqrt(x * x + y * y + z * z)
    if cosine < -0.999999:
        return _half_turn(matrix, cosine, np.array([x, y, z]))
    # atan2 keeps its digits where acos (near 1) and asin (near pi/2) lose theirs.
    scale = 0.5 if sine < 1e-9 else 0.5 * atan2(sine, cosine) / sine
    return np.array([scale * x, scale * y, scale * z])


def _half_turn(matrix: Array, cosine: float, skew: Array) -> Array:
    """Near pi the skew part vanishes; the axis is in the symmetric part."""
    # R's symmetric part is cos I + (1 - cos) a a'.
    outer = (0.5 * (matrix + matrix.T) - cosine * np.eye(3)) / (1.0 - cosine)
    k = int(np.argmax(np.diagonal(outer)))
    axis = outer[:, k] / sqrt(float(outer[k, k]))
    sign = 1.0 if float(axis @ skew) >= 0.0 else -1.0
    return sign * atan2(0.5 * sqrt(float(skew @ skew)), cosine) * axis


def matrix_from_rotation_vector(vector: Array) -> Array:
    """Exponential map: rotation matrix (3, 3) of axis times angle [rad] (Rodrigues)."""
    x, y, z = vector.tolist()
    angle = sqrt(x * x + y * y + z * z)
    if angle < 1e-9:
        return np.array([[1.0, -z, y], [z, 1.0, -x], [-y, x, 1.0]])
    a = sin(angle) / angle
    b = (1.0 - cos(angle)) / (angle * angle)
    return np.array(
        [
            [1 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y],
            [b * x * y + a * z, 1 - b * (x * x + z * z), b * y * z - a * x],
            [b * x * z - a * y, b * y * z + a * x, 1 - b * (x * x + y * y)],
        ]
    )


def matrix_from_yaw(yaw: float) -> Array:
    """Rotation about z by ``yaw`` [rad]."""
    c, s = cos(yaw), sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def yaw_of(matrix: Array) -> float:
    """Heading of a rotation matrix: direction of its x axis in the horizontal plane [rad]."""
    return atan2(matrix[1, 0], matrix[0, 0])


def wrap_angle(angle: float) -> float:
    """The same angle in (-pi, pi]."""
    return atan2(sin(angle), cos(angle))
