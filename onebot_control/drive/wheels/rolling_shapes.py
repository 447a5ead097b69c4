"""Finds the round shapes that wheels roll on, and the lowest points of shapes."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from onebot_description.arrays import Floats
from onebot_description.elements.meshes import mesh_corners
from onebot_description.elements.urdf import (
    Box,
    Capsule,
    Cylinder,
    Description,
    Geometry,
    Joint,
    Mesh,
    Shape,
    Sphere,
)
from onebot_description.errors import OneBotError
from onebot_description.geometry import matrices

_SAME = 1e-6  # m; maximum difference of radii of shapes that both touch the ground
# A cylinder, capsule or sphere is round about the axle if its center is off by at most this,
# relative to its radius; a mesh, if its extents in four directions differ by at most this.
_ROUND = 0.05


class Tyre(NamedTuple):
    """The round shape that a wheel rolls on."""

    radius: float  # m
    offset: float  # distance of its center from the joint, along the joint's axis, m


class Tyres:
    """Finds the round shapes of a robot's links, by the joint that turns them."""

    def __init__(self, description: Description, poses: Mapping[str, tuple[str, Floats]]) -> None:
        """Collect the shapes of each rigid body; ``poses`` come from ``rigid_frames``."""
        self._joints = {joint.name: joint for joint in description.joints}
        self._collisions: dict[str, list[tuple[Geometry, Floats]]] = {}
        self._visuals: dict[str, list[tuple[Geometry, Floats]]] = {}
        self._tyres: dict[str, Tyre | None] = {}
        for link in description.links:
            first, pose = poses[link.name]
            for shapes, geometries in (
                (self._collisions, link.collisions),
                (self._visuals, link.visuals),
            ):
                places = [pose @ matrices.of_origin(geometry.origin) for geometry in geometries]
                shapes.setdefault(first, []).extend(zip(geometries, places, strict=True))

    def tyre(self, name: str) -> Tyre | None:
        """Return the shape on which the link of joint ``name`` rolls; None if none is round.

        It is the largest round collision shape, which reaches the ground; if no collision shape is
        round, the largest round visual.
        """
        if name not in self._tyres:
            self._tyres[name] = self._find(self._joints[name])
        return self._tyres[name]

    def _find(self, joint: Joint) -> Tyre | None:
        axis = np.array(joint.axis)
        for shapes in (self._collisions[joint.child], self._visuals[joint.child]):
            tyres = [_tyre(geometry, pose, axis) for geometry, pose in shapes]
            if round_ones := [tyre for tyre in tyres if tyre is not None]:
                radius = max(round_ones).radius
                offsets = [tyre.offset for tyre in round_ones if tyre.radius >= radius - _SAME]
                return Tyre(radius, float(np.mean(offsets)))
        return None


def _tyre(geometry: Geometry, pose: Floats, axis: Floats) -> Tyre | None:
    """Return a shape as a tyre about ``axis``; None if it is not round about it."""
    shape = geometry.shape
    if isinstance(shape, Mesh):
        return _round_mesh(shape, pose, axis)
    if not isinstance(shape, Capsule | Cylinder | Sphere):
        return None
    offset = float(pose[:3, 3] @ axis)
    beside = float(np.linalg.norm(pose[:3, 3] - offset * axis))
    return Tyre(shape.radius, offset) if beside <= _ROUND * shape.radius else None


def _round_mesh(mesh: Mesh, pose: Floats, axis: Floats) -> Tyre | None:
    """Return the largest circle of a mesh about ``axis``; None if it is not round."""
    try:
        corners = mesh_corners(mesh)
    except OneBotError:  # reported by code that needs the mesh
        return None
    corners = matrices.transformed(corners, pose)
    along = corners @ axis
    outward = corners - np.outer(along, axis)
    side = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.9 else [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    extents = [outward @ direction for direction in (side, np.cross(axis, side))]
    reaches = [reach for extent in extents for reach in (extent.max(), -extent.min())]
    radius = float(np.linalg.norm(outward, axis=1).max())
    if min(reaches) < radius * (1.0 - _ROUND):
        return None
    return Tyre(radius, float(along.max() + along.min()) / 2.0)


def lowest_point(shape: Shape, pose: Floats) -> float:
    """Return the height of the lowest point of a shape at ``pose`` (4, 4), m."""
    up, height = pose[2, :3], float(pose[2, 3])
    if isinstance(shape, Mesh):
        return height + float((mesh_corners(shape) @ up).min())
    if isinstance(shape, Box):
        return height - float(abs(up) @ np.array(shape.size)) / 2.0
    if isinstance(shape, Sphere):
        return height - shape.radius
    around = shape.radius * (math.hypot(up[0], up[1]) if isinstance(shape, Cylinder) else 1.0)
    return height - abs(float(up[2])) * shape.length / 2.0 - around
