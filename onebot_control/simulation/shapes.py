"""Collision shapes: as PyBullet's URDF has them, how low they reach, and the meshes of files."""

import math
from collections.abc import Mapping, Sequence
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from onebot_description.description.description import Box, Cylinder, Mesh, Shape, Sphere
from onebot_description.description.mesh_scene import mesh_corners, read_mesh

Floats = NDArray[np.float64]

_MARGIN = 0.001  # m by which PyBullet's convex hulls are larger than their mesh


def geometry(shape: Shape, meshes: Mapping[str, str]) -> Element:
    """Return the element within <geometry>; ``meshes`` are files by URI."""
    if isinstance(shape, Mesh):
        return Element("mesh", filename=meshes[shape.uri], scale=words(shape.scale))
    if isinstance(shape, Box):
        return Element("box", size=words(shape.size))
    if isinstance(shape, Sphere):
        return Element("sphere", radius=repr(shape.radius))
    kind = "cylinder" if isinstance(shape, Cylinder) else "capsule"
    return Element(kind, radius=repr(shape.radius), length=repr(shape.length))


def words(values: Sequence[float] | Floats) -> str:
    """Return numbers as the text of an XML attribute."""
    return " ".join(repr(float(value)) for value in np.asarray(values, float))


def is_round(shape: Shape) -> bool:
    """Whether a shape can support a robot as a caster does."""
    return not isinstance(shape, Mesh | Box)


def bottom(shape: Shape, pose: Floats) -> float:
    """Return the least height of a shape at ``pose``."""
    up, height = pose[2, :3], float(pose[2, 3])
    if isinstance(shape, Mesh):
        corners = mesh_corners(shape) * np.array(shape.scale)
        return height + float((corners @ up).min()) - _MARGIN
    if isinstance(shape, Box):
        return height - float(abs(up) @ np.array(shape.size)) / 2.0
    if isinstance(shape, Sphere):
        return height - shape.radius
    around = shape.radius * (math.hypot(up[0], up[1]) if isinstance(shape, Cylinder) else 1.0)
    return height - abs(float(up[2])) * shape.length / 2.0 - around


def as_obj(mesh: Mesh, convex: bool) -> str:
    """Return a mesh file, or its convex hull, in metres, as Wavefront OBJ.

    Raises:
        OneBotError: it cannot be read, or holds no triangles.
    """
    corners, faces = read_mesh(mesh)
    if convex:
        faces = _hull(corners)
    used, faces = np.unique(faces, return_inverse=True)
    lines = ["v " + " ".join(map(repr, corner)) for corner in corners[used].tolist()]
    lines += ["f " + " ".join(map(str, face)) for face in (faces.reshape(-1, 3) + 1).tolist()]
    return "\n".join(lines) + "\n"


def _hull(corners: NDArray[np.float64]) -> NDArray[np.intp]:
    """The faces (N, 3) of the convex hull of (M, 3) corners.

    It is all that PyBullet makes of a mesh, but in minutes.
    """
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(ConvexHull(corners).simplices, np.intp)
    except QhullError:  # it is flat: any faces will do, as only the corners count
        count = len(corners)
        return np.arange(3 * -(-count // 3), dtype=np.intp).reshape(-1, 3) % count
