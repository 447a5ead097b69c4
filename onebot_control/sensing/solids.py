"""Solids: the visual shapes of links as triangles with colors.

Round shapes up to the size of a robot have enough facets for an accuracy of 1 mm, except for rays
that graze a sphere.
"""

import functools
import itertools
import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_control.physics.engine import logger
from onebot_description.arrays import Floats, Singles
from onebot_description.elements.meshes import (
    colored_triangles,
    has_colors,
    look_warnings,
    mesh_scene,
    surfaces,
)
from onebot_description.elements.urdf import (
    Box,
    Capsule,
    Cylinder,
    Description,
    Geometry,
    Mesh,
    Rgba,
    Sphere,
)
from onebot_description.errors import OneBotError
from onebot_description.geometry import matrices
from onebot_description.model.robot_model import RobotModel

Integers = NDArray[np.int32]

_PLAIN: Rgba = (0.7, 0.7, 0.7, 1.0)  # color of a visual without a color
_SECTIONS = 2200  # facets around a cylinder of radius 1 m
_MAX_SECTIONS = {Cylinder: 4096, Capsule: 256}
_HIGH = 1e-4  # m between the highest and the lowest point of a sphere's facet
_ICOSAHEDRON = 0.292  # m, this height for an icosahedron of radius 1; a subdivision quarters it
_MAX_SUBDIVISIONS = 6  # maximum subdivisions of a sphere: 82,000 facets


# Corners and triangles of a cube with edges of 1 m, as in trimesh, which is slow to import.
_CUBE = np.array([*itertools.product((-0.5, 0.5), repeat=3)])
_CUBE_FACES = np.array(
    [
        *((1, 3, 0), (4, 1, 0), (0, 3, 2), (2, 4, 0), (1, 7, 3), (5, 1, 4)),
        *((5, 7, 1), (3, 7, 2), (6, 4, 2), (2, 7, 6), (6, 5, 4), (7, 5, 6)),
    ]
)


class Texture(NamedTuple):
    """A texture image on n consecutive faces of a solid."""

    first: int  # index of the first of these faces
    places: Singles  # (n, 3, 2), texture coordinates of the corners, 0 to 1, from bottom left
    image: NDArray[np.uint8]  # (H, W, 3), rows from the top


class Solid(NamedTuple):
    """Triangles with colors and textures, in one frame."""

    corners: Singles  # (N, 3), m
    faces: Integers  # (F, 3)
    colors: Singles  # (F, 3), sRGB, 0 to 1
    textures: tuple[Texture, ...]

    @property
    def box(self) -> Floats:
        """The bounding box: minimum and maximum corner (2, 3), m; the origin without triangles."""
        corners = self.corners if len(self.corners) else np.zeros((1, 3))
        return np.array([corners.min(axis=0), corners.max(axis=0)], float)

    @property
    def sphere(self) -> tuple[Floats, float]:
        """Center (3,) and radius of a bounding sphere, m."""
        center = self.box.mean(axis=0)
        return center, float(np.linalg.norm(self.corners - center, axis=1).max(initial=0.0))


class _Part(NamedTuple):
    corners: Floats
    faces: NDArray[np.intp]
    colors: Floats | None = None  # (F, 3) or (3,); None: the color of the visual
    texture: tuple[Floats, NDArray[np.uint8]] | None = None


def solid_of(geometries: Iterable[tuple[Geometry, Floats]]) -> Solid:
    """Merge visuals to one solid; visuals that cannot be read are logged and skipped.

    Args:
        geometries: visuals, each with the pose (4, 4) of its link.
    """
    corners, faces, colors = [], [], []
    textures: list[Texture] = []
    corner_count = face_count = 0
    for geometry, link in geometries:
        color = geometry.color or _PLAIN
        for part in _parts(geometry) if color[3] > 0.0 else ():  # 0: hidden on purpose
            pose = link @ matrices.of_origin(geometry.origin)
            corners.append(matrices.transformed(part.corners, pose))
            faces.append(part.faces + corner_count)
            look = np.array(color[:3]) if part.colors is None else part.colors
            colors.append(np.broadcast_to(look, (len(part.faces), 3)))
            if part.texture is not None:
                places, image = part.texture
                textures.append(Texture(face_count, places[part.faces].astype(np.float32), image))
            corner_count += len(part.corners)
            face_count += len(part.faces)
    return Solid(
        np.concatenate([np.empty((0, 3)), *corners]).astype(np.float32),
        np.concatenate([np.empty((0, 3), int), *faces]).astype(np.int32),
        np.concatenate([np.empty((0, 3)), *colors]).astype(np.float32),
        tuple(textures),
    )


def robot_solid(robot: Description) -> Solid:
    """Return the collision shapes, or else the visuals, of a robot whose joints are at 0."""
    poses = RobotModel.from_description(robot).link_matrices({})
    return solid_of(
        (shape, poses[link.name])
        for link in robot.links
        for shape in link.collisions or link.visuals
    )


def _parts(geometry: Geometry) -> list[_Part]:
    """Return the parts of a visual."""
    shape = geometry.shape
    if isinstance(shape, Mesh):
        try:
            state = shape.path and shape.path.stat()
            parts = _mesh(shape, state and (state.st_mtime_ns, state.st_size))
            return [part for part in parts if len(part.faces)]
        except (OneBotError, OSError) as error:
            logger.warning("%s: sensors do not see this mesh: %s", geometry.where, error)
            return []
    return [_primitive(shape)]


@functools.lru_cache(maxsize=256)
def _primitive(shape: Box | Capsule | Cylinder | Sphere) -> _Part:
    """Return a box, or facets that extend equally far inside and outside of a round shape."""
    if isinstance(shape, Box):
        return _Part(_CUBE * shape.size, _CUBE_FACES)
    from trimesh import creation

    if isinstance(shape, Sphere):
        subdivisions = math.ceil(math.log(max(_ICOSAHEDRON * shape.radius / _HIGH, 1.0), 4.0))
        ball = creation.icosphere(min(subdivisions, _MAX_SUBDIVISIONS))
        nearest = np.abs((ball.triangles[:, 0] * ball.face_normals).sum(axis=1)).min()
        return _Part(ball.vertices * (2.0 * shape.radius / (1.0 + nearest)), ball.faces)
    sections = min(max(64, math.ceil(_SECTIONS * shape.radius)), _MAX_SECTIONS[type(shape)])
    wider = 2.0 * shape.radius / (1.0 + np.cos(np.pi / sections))
    if isinstance(shape, Capsule):
        capsule = creation.capsule(shape.length, wider, count=[sections // 2, sections + 1])
        return _Part(capsule.vertices - capsule.bounds.mean(axis=0), capsule.faces)
    tube = creation.cylinder(wider, shape.length, sections=sections)
    return _Part(tube.vertices, tube.faces)


@functools.lru_cache(maxsize=256)
def _mesh(mesh: Mesh, state: tuple[int, int] | None) -> tuple[_Part, ...]:
    """Return the surfaces of a mesh file; as in RViz, its colors override the visual's.

    ``state`` is part of the cache's key, so that an edited file is read again.
    """
    turn = -1 if np.prod(mesh.scale) < 0.0 else 1  # a mirrored triangle is wound the other way
    if mesh.path and (plain := colored_triangles(mesh.path)):
        return tuple(
            _Part(
                (corners * mesh.scale).reshape(-1, 3),
                np.arange(3 * len(corners)).reshape(-1, 3)[:, ::turn],
                color,
            )
            for corners, color in plain
        )
    scene = mesh_scene(mesh)
    assert mesh.path is not None
    for text in look_warnings(scene):
        logger.warning("%s; cameras do not see it", text)
    has_own_colors = has_colors(mesh.path, scene)
    parts = []
    for surface in surfaces(scene):
        corners = np.asarray(surface.vertices, float) * mesh.scale
        faces = np.asarray(surface.faces, np.intp)[:, ::turn]
        colors, texture = _look(surface.visual) if has_own_colors else (None, None)
        parts.append(_Part(corners, faces, colors, texture))
    return tuple(parts)


def _look(visual: Any) -> tuple[Floats | None, tuple[Floats, NDArray[np.uint8]] | None]:
    """Return colors (F, 3) or (3,), and texture coordinates with their image."""
    if visual.kind == "texture":
        material = visual.material
        image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
        color = np.asarray(material.main_color, float)[:3] / 255.0
        if image is None or visual.uv is None:
            return color, None
        return color, (np.asarray(visual.uv, float), np.asarray(image.convert("RGB")))
    if visual.kind is not None and visual.defined:
        return np.asarray(visual.face_colors, float)[:, :3] / 255.0, None
    return None, None
