"""How large the robot is, so that the first view shows all of it."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from onebot_bringup.viewer.geometry import Box, Capsule, Cylinder, Geometry, Sphere, Vector
from onebot_bringup.viewer.meshes import load_mesh, resolve
from onebot_description.errors import OneBotError
from onebot_description.model.quaternions import to_matrix

Floats = NDArray[np.float64]


def corners(geometry: Geometry) -> Floats:
    """Return the (8, 3) corners of the box around ``geometry``, metres, in its link's frame.

    Raises:
        OneBotError: its mesh cannot be read.
    """
    low, high = _extent(geometry)
    grid = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    local = np.where(grid == 1, high, low)
    turned = np.asarray(local @ to_matrix(np.asarray(geometry.rotation)).T, np.float64)
    moved: Floats = turned + np.array(geometry.translation)
    return moved


def _extent(geometry: Geometry) -> tuple[Floats, Floats]:
    shape = geometry.shape
    if isinstance(shape, Box):
        half = np.array(shape.size) / 2
    elif isinstance(shape, Cylinder):
        half = np.array([shape.radius, shape.radius, shape.length / 2])
    elif isinstance(shape, Sphere):
        half = np.full(3, shape.radius)
    elif isinstance(shape, Capsule):
        half = np.array([shape.radius, shape.radius, shape.length / 2 + shape.radius])
    else:
        scaled = load_mesh(resolve(shape.uri)).bounds * np.array(shape.scale)
        return scaled.min(axis=0), scaled.max(axis=0)
    return -half, half


def robot_bounds(geometries: tuple[Geometry, ...], poses: Mapping[str, Floats]) -> Floats | None:
    """Return the (2, 3) box around all visuals, metres, in the fixed frame.

    Args:
        geometries: what is drawn.
        poses: (4, 4) matrices of the links in the fixed frame; links not in it are left out.
    """
    points = []
    for geometry in geometries:
        if geometry.kind != "visual" or geometry.link not in poses:
            continue
        try:
            local = corners(geometry)
        except OneBotError:
            continue  # said when it was drawn
        pose = poses[geometry.link]
        points.append(local @ pose[:3, :3].T + pose[:3, 3])
    if not points:
        return None
    cloud = np.concatenate(points)
    return np.array([cloud.min(axis=0), cloud.max(axis=0)])


def fitting_eye(bounds: Floats) -> tuple[Vector, Vector]:
    """Return eye and target, metres, from which the whole box is seen, from front left above."""
    center = bounds.mean(axis=0)
    radius = max(float(np.linalg.norm(bounds[1] - bounds[0])) / 2, 0.01)
    direction = np.array([1.0, 0.75, 0.65])
    # A field of view of about 55 degrees; a bit of air around the robot.
    eye = center + direction / np.linalg.norm(direction) * radius * 2.6
    return _vector(eye), _vector(center)


def _vector(values: Floats) -> Vector:
    x, y, z = (round(float(value), 4) for value in values)
    return x, y, z
