"""Homogeneous transforms as matrices (..., 4, 4): rotation, translation in m, last row 0 0 0 1."""

import math

import numpy as np

from onebot_description.arrays import Floats
from onebot_description.geometry import quaternions
from onebot_description.geometry.poses import (
    Origin,
    PlanarPose,
    Transform,
    rows_of,
    rpy_of_rows,
)


def of_transform(transform: Transform) -> Floats:
    """Return the matrix of one transform, ten times as fast as ``of_poses``.

    Its quaternion may have any length; length 0 means the identity.
    """
    (at_x, at_y, at_z), (x, y, z, w) = transform
    length = math.hypot(x, y, z, w) or 1.0
    first, second, third = rows_of((x / length, y / length, z / length, w / length))
    return np.array([[*first, at_x], [*second, at_y], [*third, at_z], [0.0, 0.0, 0.0, 1.0]])


def of_poses(poses: Floats) -> Floats:
    """Return the matrices (..., 4, 4) of poses (..., 7): x y z in m, quaternion x y z w."""
    matrices = np.zeros((*poses.shape[:-1], 4, 4))
    matrices[..., :3, :3] = quaternions.to_matrix(poses[..., 3:])
    matrices[..., :3, 3] = poses[..., :3]
    matrices[..., 3, 3] = 1.0
    return matrices


def transformed(points: Floats, matrix: Floats) -> Floats:
    """Return points (N, 3) of a frame, m, in its parent; the frame is at ``matrix`` (4, 4)."""
    moved: Floats = points @ matrix[:3, :3].T + matrix[:3, 3]
    return moved


def of_origin(origin: Origin) -> Floats:
    """Return the matrix of a URDF origin."""
    return of_transform(origin.transform)


def to_origin(matrix: Floats) -> Origin:
    """Return the URDF origin of a matrix; see ``rpy_of_rows``."""
    x, y, z = matrix[:3, 3].tolist()
    return Origin((x, y, z), rpy_of_rows(matrix[:3, :3].tolist()))


def to_planar(matrix: Floats) -> PlanarPose:
    """Return the pose seen from above; the yaw is that of the x axis."""
    x, y = matrix[:2, 3].tolist()
    return PlanarPose(x, y, math.atan2(matrix[1, 0], matrix[0, 0]))
