"""Collision shapes: as PyBullet's URDF has them, how low they reach, and the meshes of files."""

import math
from collections.abc import Mapping, Sequence
from io import BytesIO
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from onebot_description.description.description import Box, Cylinder, Mesh, Shape, Sphere
from onebot_description.description.meshes import fault_of, without_materials
from onebot_description.errors import OneBotError

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


def mesh_corners(mesh: Mesh) -> NDArray[np.float64]:
    """Return the corners (N, 3) of all triangles of a mesh file, in metres, unscaled.

    Raises:
        OneBotError: it cannot be read, or holds no triangles.
    """
    return _triangles(mesh)[0]


def mesh_parts(mesh: Mesh, *, materials: bool) -> list[Any]:
    """Return the surfaces of a mesh file as trimesh.Trimesh, in metres, unscaled.

    Args:
        mesh: names the file.
        materials: read how they look, too; a broken material may cost surfaces.

    Raises:
        OneBotError: it cannot be read, or holds no triangles.
    """
    import trimesh

    path = mesh.path
    if path is None:
        raise OneBotError(mesh.problem)
    if fault := fault_of(path):
        raise OneBotError(f"{path} {fault}")
    try:
        if path.suffix.lower() == ".dae":
            surfaces = str(path) if materials else BytesIO(without_materials(path))
            scene = trimesh.load_scene(surfaces, file_type="dae", process=False)
            scene = scene.convert_units("meters")
        else:
            scene = trimesh.load_scene(str(path), process=False)
        parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh)]
    except Exception as error:  # trimesh and its parsers raise exceptions of many types
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise OneBotError(f"{path} cannot be read: {reason}") from error
    if not any(len(part.faces) for part in parts):
        raise OneBotError(f"{path} holds no triangles")
    return parts


def _triangles(mesh: Mesh) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """The corners (N, 3) of a mesh file, and the triangles (M, 3) of which they are."""
    parts = mesh_parts(mesh, materials=False)
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    corners = np.concatenate([np.asarray(part.vertices, float) for part in parts])
    faces = [np.asarray(part.faces, np.intp) + at for part, at in zip(parts, starts, strict=False)]
    return corners, np.concatenate(faces)


def as_obj(mesh: Mesh, convex: bool) -> str:
    """Return a mesh file, or its convex hull, in metres, as Wavefront OBJ.

    Raises:
        OneBotError: it cannot be read, or holds no triangles.
    """
    corners, faces = _triangles(mesh)
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
