"""Unit quaternions as arrays, x y z w last, as in geometry_msgs."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from onebot_description.arrays import Floats


def from_rpy(rpy: ArrayLike) -> Floats:
    """Return the quaternions of fixed-axis roll, pitch, yaw.

    Args:
        rpy: (..., 3) radians; the rotation is Rz(yaw) Ry(pitch) Rx(roll), as URDF defines it.

    Returns:
        (..., 4), x y z w.
    """
    angles = np.asarray(rpy, float) / 2.0
    (sr, sp, sy), (cr, cp, cy) = (
        np.moveaxis(np.sin(angles), -1, 0),
        np.moveaxis(np.cos(angles), -1, 0),
    )
    components: Sequence[Floats] = (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )
    return np.stack(components, axis=-1)


def from_matrix(matrix: Floats) -> Floats:
    """Return the quaternion (4,), x y z w, of a rotation matrix (3, 3)."""
    return from_rpy(to_rpy(matrix))


def multiply(a: Floats, b: Floats) -> Floats:
    """Return the Hamilton product a (x) b: the rotation b, then a. Shapes (..., 4) broadcast."""
    ax, ay, az, aw = np.moveaxis(a, -1, 0)
    bx, by, bz, bw = np.moveaxis(b, -1, 0)
    return np.stack(
        (
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ),
        axis=-1,
    )


def rotate(rotation: Floats, vector: Floats) -> Floats:
    """Rotate vectors (..., 3) by unit quaternions (..., 4).

    The formula is v + 2 w (u x v) + 2 u x (u x v), with the quaternion's vector part u.
    """
    axis, scalar = rotation[..., :3], rotation[..., 3:]
    twice = 2.0 * np.cross(axis, vector)
    rotated: Floats = vector + scalar * twice + np.cross(axis, twice)
    return rotated


def normalized(rotation: Floats) -> Floats:
    """Return unit quaternions (..., 4) for quaternions of any length; the identity for 0."""
    length = np.linalg.norm(rotation, axis=-1, keepdims=True)
    unit = rotation / np.where(length > 0.0, length, 1.0)
    return np.where(length > 0.0, unit, (0.0, 0.0, 0.0, 1.0))


def to_matrix(rotation: ArrayLike) -> Floats:
    """Return the rotation matrices (..., 3, 3) of quaternions (..., 4); the identity for 0."""
    x, y, z, w = np.moveaxis(normalized(np.asarray(rotation, float)), -1, 0)
    xx, yy, zz = 2.0 * x * x, 2.0 * y * y, 2.0 * z * z
    xy, xz, yz = 2.0 * x * y, 2.0 * x * z, 2.0 * y * z
    wx, wy, wz = 2.0 * w * x, 2.0 * w * y, 2.0 * w * z
    rows = (
        (1.0 - yy - zz, xy - wz, xz + wy),
        (xy + wz, 1.0 - xx - zz, yz - wx),
        (xz - wy, yz + wx, 1.0 - xx - yy),
    )
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def to_rpy(matrix: Floats) -> tuple[float, float, float]:
    """Return roll, pitch and yaw about the fixed axes, rad, of a rotation matrix (3, 3).

    At a pitch of a quarter turn (gimbal lock), only the sum or difference of roll and yaw is
    defined; then yaw is zero.
    """
    (xx, _, _), (yx, yy, yz), (zx, zy, zz) = matrix.tolist()
    pitch = math.asin(max(-1.0, min(1.0, -zx)))
    if abs(zx) > 1.0 - 1e-12:
        return math.atan2(-yz, yy), pitch, 0.0
    return math.atan2(zy, zz), pitch, math.atan2(yx, xx)
