"""Rotations as arrays of unit quaternions (..., 4), x y z w, as in geometry_msgs."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from onebot_description.arrays import Floats
from onebot_description.geometry import poses

UNIT_TOLERANCE = 0.01
"""How far the squared length of a unit quaternion may be from 1, as in tf2."""


def from_rpy(rpy: ArrayLike) -> Floats:
    """Return the quaternions (..., 4) of fixed-axis roll, pitch, yaw (..., 3), rad."""
    angles = np.asarray(rpy, float) / 2.0
    return _stacked(poses.of_half_angles(_parts(np.sin(angles)), _parts(np.cos(angles))))


def from_matrix(matrix: Floats) -> Floats:
    """Return the quaternion (4,), x y z w, of a rotation matrix (3, 3)."""
    return np.array(poses.from_rpy(poses.rpy_of_rows(matrix.tolist())))


def multiply(a: Floats, b: Floats) -> Floats:
    """Return the Hamilton product a (x) b: the rotation b, then a. Shapes (..., 4) broadcast."""
    return _stacked(poses.multiply(_parts(a), _parts(b)))


def rotate(rotation: Floats, vector: Floats) -> Floats:
    """Rotate vectors (..., 3) by unit quaternions (..., 4); shapes broadcast."""
    return _stacked(poses.rotate(_parts(rotation), _parts(vector)))


def normalized(rotation: Floats) -> Floats:
    """Return unit quaternions (..., 4) for quaternions of any length; the identity for 0."""
    length = np.linalg.norm(rotation, axis=-1, keepdims=True)
    unit = rotation / np.where(length > 0.0, length, 1.0)
    return np.where(length > 0.0, unit, (0.0, 0.0, 0.0, 1.0))


def to_matrix(rotation: ArrayLike) -> Floats:
    """Return the rotation matrices (..., 3, 3) of quaternions (..., 4); the identity for 0."""
    unit = normalized(np.asarray(rotation, float))
    matrices = np.empty((*unit.shape[:-1], 3, 3))
    for row, values in enumerate(poses.rows_of(_parts(unit))):
        for column, value in enumerate(values):
            matrices[..., row, column] = value
    return matrices


def _parts(array: Floats) -> Any:
    """Return the components of the last axis."""
    return np.moveaxis(array, -1, 0)


def _stacked(parts: tuple[Floats, ...]) -> Floats:
    return np.stack(parts, axis=-1)
