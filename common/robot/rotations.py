"""Rotations in three dimensions on numpy arrays, lean enough for a control loop.

Quaternions are unit, shape (4,), scalar first (w, x, y, z); rotation vectors, shape (3,), are axis
times angle [rad]; matrices are (3, 3). A rotation of frame B in frame A takes components in B to
components in A. Angles are in rad. Nothing here validates its input.
"""

from collections.abc import Sequence
from math import asin, atan2, copysign, cos, sin, sqrt

import numpy as np

from common.schemas.arrays import Float64Array as Array


def wrap_angle(angle: float) -> float:
    """Return the same angle in (-pi, pi]."""
    return atan2(sin(angle), cos(angle))


def clamp_norm(vector: Array, limit: float) -> Array:
    """Return ``vector`` (n,), shortened to the length ``limit`` if it is longer."""
    norm = float(np.sqrt(vector @ vector))
    return vector if norm <= limit else vector * (limit / norm)


def rotate_about_z(vector: Array, angle: float) -> Array:
    """Return ``vector`` (3,) rotated by ``angle`` about the z axis."""
    c, s = cos(angle), sin(angle)
    x, y, z = vector.tolist()
    return np.array([c * x - s * y, s * x + c * y, z])


# Quaternions.


def normalised(quaternion: Array) -> Array:
    """Return ``quaternion`` (4,) scaled to norm one; its norm must not be zero."""
    return quaternion / sqrt(float(quaternion @ quaternion))


def conjugate(quaternion: Array) -> Array:
    """Return the inverse rotation of a unit quaternion (4,)."""
    w, x, y, z = quaternion.tolist()
    return np.array([w, -x, -y, -z])


def nearer_sign(quaternion: Array, reference: Array) -> Array:
    """Return ``quaternion`` (4,) or its negative, whichever is nearer to ``reference`` (4,)."""
    return -quaternion if float(quaternion @ reference) < 0.0 else quaternion


def multiply(a: Array, b: Array) -> Array:
    """Return the Hamilton product (4,): the rotation ``b`` followed by ``a``, about parent axes."""
    return np.array(multiplied(a.tolist(), b.tolist()))


def multiplied(a: Sequence[float], b: Sequence[float]) -> tuple[float, float, float, float]:
    """Return what :func:`multiply` does, in plain numbers: a chain of them makes no arrays."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def rotate_vector(quaternion: Array, vector: Array) -> Array:
    """Return ``vector`` (3,) rotated by a unit quaternion (4,)."""
    # In plain numbers: for three of them numpy's cross product takes forty times as long.
    return np.array(rotated(quaternion.tolist(), vector.tolist()))


def rotated(quaternion: Sequence[float], vector: Sequence[float]) -> tuple[float, float, float]:
    """Return what :func:`rotate_vector` does, in plain numbers."""
    w, x, y, z = quaternion
    a, b, c = vector
    p, q, r = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return (
        a + w * p + (y * r - z * q),
        b + w * q + (z * p - x * r),
        c + w * r + (x * q - y * p),
    )


def quaternion_from_rotation_vector(vector: Array) -> Array:
    """Return the quaternion (4,) of a rotation vector (3,) of any length."""
    x, y, z = vector.tolist()
    angle = sqrt(x * x + y * y + z * z)
    scale = 0.5 if angle < 1e-9 else sin(0.5 * angle) / angle
    return np.array([cos(0.5 * angle), scale * x, scale * y, scale * z])


def rotation_between(start: Array, end: Array) -> Array:
    """Return the shortest rotation vector (3,), about parent axes, from ``start`` to ``end``.

    Args:
        start: (4,).
        end: (4,); its sign makes no difference.
    """
    w, *vector = multiply(end, conjugate(start))
    xyz = np.array(vector)
    sine = float(np.linalg.norm(xyz))
    if sine == 0.0:
        return np.zeros(3)
    angle = 2.0 * atan2(sine, abs(w))
    return (copysign(angle, w) / sine) * xyz


def rotate(start: Array, rotation: Array) -> Array:
    """Return ``start`` (4,) rotated by the rotation vector ``rotation`` (3,) about parent axes.

    For at most half a turn this is, of the result's two quaternions, the one nearer to ``start``,
    so a target that moves in small turns never flips sign.
    """
    return normalised(multiply(quaternion_from_rotation_vector(rotation), start))


def quaternion_from_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Return the quaternion (4,) of Rz(yaw) Ry(pitch) Rx(roll): about fixed x, then y, then z."""
    axes = np.eye(3)
    turned = multiply(
        quaternion_from_rotation_vector(pitch * axes[1]),
        quaternion_from_rotation_vector(roll * axes[0]),
    )
    return multiply(quaternion_from_rotation_vector(yaw * axes[2]), turned)


def rpy_from_quaternion(quaternion: Array) -> tuple[float, float, float]:
    """Return roll, pitch, yaw of a unit quaternion: the inverse of :func:`quaternion_from_rpy`."""
    w, x, y, z = quaternion.tolist()
    roll = atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = asin(min(1.0, max(-1.0, 2 * (w * y - z * x))))
    return roll, pitch, yaw_from_quaternion(quaternion)


def yaw_from_quaternion(quaternion: Array) -> float:
    """Return the heading of a unit quaternion: its x axis' direction in the horizontal plane."""
    w, x, y, z = quaternion.tolist()
    return atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))


# Matrices.


def matrix_from_quaternion(quaternion: Array) -> Array:
    """Return the rotation matrix (3, 3) of a quaternion (4,), normalised first."""
    w, x, y, z = quaternion.tolist()
    s = 2.0 / (w * w + x * x + y * y + z * z)
    return np.array(
        [
            [1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)],
            [s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)],
            [s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)],
        ]
    )


def matrix_from_rotation_vector(vector: Array) -> Array:
    """Return the rotation matrix (3, 3) of a rotation vector (3,) (Rodrigues' formula)."""
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
    """Return the rotation matrix (3, 3) about z by ``yaw``."""
    c, s = cos(yaw), sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def yaw_from_matrix(matrix: Array) -> float:
    """Return the heading of a matrix (3, 3): its x axis' direction in the horizontal plane."""
    return atan2(matrix[1, 0], matrix[0, 0])


def rotation_vector_from_matrix(matrix: Array) -> Array:
    """Return the rotation vector (3,), of an angle in [0, pi], of a rotation matrix (3, 3)."""
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    x, y, z = h - f, c - g, d - b
    cosine = min(1.0, max(-1.0, 0.5 * (a + e + i - 1.0)))
    sine = 0.5 * sqrt(x * x + y * y + z * z)
    if cosine < -0.999999:
        return _near_half_turn(matrix, cosine, np.array([x, y, z]))
    # atan2 keeps its digits where acos (near 1) and asin (near pi/2) lose theirs.
    scale = 0.5 if sine < 1e-9 else 0.5 * atan2(sine, cosine) / sine
    return np.array([scale * x, scale * y, scale * z])


def _near_half_turn(matrix: Array, cosine: float, skew: Array) -> Array:
    """Read the axis from the symmetric part, for near pi the skew part vanishes."""
    # R's symmetric part is cos I + (1 - cos) a a'.
    outer = (0.5 * (matrix + matrix.T) - cosine * np.eye(3)) / (1.0 - cosine)
    k = int(np.argmax(np.diagonal(outer)))
    axis = outer[:, k] / sqrt(float(outer[k, k]))
    sign = 1.0 if float(axis @ skew) >= 0.0 else -1.0
    return sign * atan2(0.5 * sqrt(float(skew @ skew)), cosine) * axis
