"""Solids: the visual shapes of links as triangles with colours.

Cylinders and spheres are enclosed by facets, which select the rays that may hit them; ``Rounds``
computes the exact hits.
"""

import functools
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_control.physics.engine import logger
from onebot_description.arrays import Floats, Singles
from onebot_description.elements.description import (
    Box,
    Capsule,
    Cylinder,
    Description,
    Geometry,
    Mesh,
    Rgba,
    Sphere,
)
from onebot_description.elements.meshes import has_colors, mesh_scene, surfaces
from onebot_description.errors import OneBotError
from onebot_description.geometry import matrices
from onebot_description.model.robot_model import RobotModel

Integers = NDArray[np.int32]

_PLAIN: Rgba = (0.7, 0.7, 0.7, 1.0)  # colour of a visual without one
_SECTIONS, _SUBDIVISIONS = 64, 3  # facets around cylinders and spheres


class Rounds(NamedTuple):
    """Exact cylinders and spheres, for intersection with rays."""

    rotations: Floats  # (K, 3, 3), from the solid's frame to theirs
    centers: Floats  # (K, 3)
    radii: Floats  # (K,)
    halves: Floats  # (K,), half the length along z; infinite for a sphere

    @classmethod
    def of(cls, shapes: Sequence[tuple[Floats, float, float]]) -> "Rounds":
        """Collect shapes, each given by pose (4, 4), radius and half length (m)."""
        poses = np.array([pose for pose, _, _ in shapes]).reshape(-1, 4, 4)
        radii, halves = np.array([shape[1:] for shape in shapes]).reshape(-1, 2).T
        return cls(poses[:, :3, :3].transpose(0, 2, 1), poses[:, :3, 3], radii, halves)

    def distances(self, which: Integers, origins: Singles, directions: Floats) -> Floats:
        """Return the distance (N,) from each ray's origin to its shape; infinite where it misses.

        Args:
            which: (N,), index of the shape for each ray.
            origins: (N, 3), in the solid's frame.
            directions: (N, 3), in the solid's frame; distances are in their lengths.
        """
        turn = self.rotations[which]
        o = np.einsum("nij,nj->ni", turn, origins - self.centers[which])
        d = np.einsum("nij,nj->ni", turn, directions)
        radius, half = self.radii[which], self.halves[which]
        # Solve |o + t d|^2 = r^2 for t; for a cylinder, without z.
        across = np.where(np.isinf(half)[:, None], 1.0, (1.0, 1.0, 0.0))
        a = (across * d * d).sum(axis=1)
        b = (across * o * d).sum(axis=1)
        c = (across * o * o).sum(axis=1) - radius * radius
        with np.errstate(divide="ignore", invalid="ignore"):
            root = np.sqrt(b * b - a * c)
            sides = np.stack([(-b - root) / a, (-b + root) / a])
            sides[~(np.abs(o[:, 2] + sides * d[:, 2]) <= half)] = np.inf
            caps = np.stack([(-half - o[:, 2]) / d[:, 2], (half - o[:, 2]) / d[:, 2]])
            x, y = (o[:, axis] + caps * d[:, axis] for axis in (0, 1))
            caps[~(x * x + y * y <= radius * radius)] = np.inf
        candidates = np.concatenate([sides, caps])
        candidates[~(candidates > 0.0)] = np.inf
        nearest: Floats = candidates.min(axis=0)
        return nearest


class Texture(NamedTuple):
    """A texture image on n consecutive faces of a solid."""

    first: int  # index of the first of these faces
    places: Singles  # (n, 3, 2), texture coordinates of the corners, 0 to 1, from bottom left
    image: NDArray[np.uint8]  # (H, W, 3), rows from the top


class Solid(NamedTuple):
    """Triangles with colours, round shapes and textures, in one frame."""

    corners: Singles  # (N, 3), m
    faces: Integers  # (F, 3)
    colors: Singles  # (F, 3), sRGB, 0 to 1
    round_of: Integers  # (F,), index in ``rounds`` of the shape that a face encloses; -1: none
    rounds: Rounds
    textures: tuple[Texture, ...]

    @property
    def box(self) -> Floats:
        """The bounding box: least and greatest corner (2, 3), m; the origin without triangles."""
        corners = self.corners if len(self.corners) else np.zeros((1, 3))
        return np.array([corners.min(axis=0), corners.max(axis=0)], float)

    @property
    def sphere(self) -> tuple[Floats, float]:
        """Centre (3,) and radius of a bounding sphere, m."""
        center = self.box.mean(axis=0)
        return center, float(np.linalg.norm(self.corners - center, axis=1).max(initial=0.0))


class _Part(NamedTuple):
    corners: Floats
    faces: NDArray[np.intp]
    colors: Floats | None = None  # (F, 3) or (3,); None: the visual's
    round: tuple[float, float] | None = None  # radius and half length of what it is around
    texture: tuple[Floats, NDArray[np.uint8]] | None = None


def solid_of(geometries: Iterable[tuple[Geometry, Floats]]) -> Solid:
    """Merge visuals to one solid; those that cannot be read are logged and left out.

    Args:
        geometries: visuals, each with the pose (4, 4) of its link.
    """
    corners, faces, colors, round_of = [], [], [], []
    rounds: list[tuple[Floats, float, float]] = []
    textures: list[Texture] = []
    corner_count = face_count = 0
    for geometry, link in geometries:
        color = geometry.color or _PLAIN
        for part, height in _parts(geometry) if color[3] > 0.0 else ():  # 0: hidden on purpose
            pose = link @ matrices.of_origin(geometry.origin)
            pose[:3, 3] += height * pose[:3, 2]
            corners.append(matrices.transformed(part.corners, pose))
            faces.append(part.faces + corner_count)
            look = np.array(color[:3]) if part.colors is None else part.colors
            colors.append(np.broadcast_to(look, (len(part.faces), 3)))
            round_of.append(np.full(len(part.faces), -1 if part.round is None else len(rounds)))
            if part.round is not None:
                rounds.append((pose, *part.round))
            if part.texture is not None:
                places, image = part.texture
                textures.append(Texture(face_count, places[part.faces].astype(np.float32), image))
            corner_count += len(part.corners)
            face_count += len(part.faces)
    return Solid(
        np.concatenate([np.empty((0, 3)), *corners]).astype(np.float32),
        np.concatenate([np.empty((0, 3), int), *faces]).astype(np.int32),
        np.concatenate([np.empty((0, 3)), *colors]).astype(np.float32),
        np.concatenate([np.empty(0, int), *round_of]).astype(np.int32),
        Rounds.of(rounds),
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


def _parts(geometry: Geometry) -> list[tuple[_Part, float]]:
    """Return the parts of a visual, each with its height (z) in the visual's frame."""
    shape = geometry.shape
    if isinstance(shape, Mesh):
        try:
            state = shape.path and shape.path.stat()
            parts = _mesh(shape, state and (state.st_mtime_ns, state.st_size))
            return [(part, 0.0) for part in parts if len(part.faces)]
        except (OneBotError, OSError) as error:
            logger.warning("%s: sensors do not see this mesh: %s", geometry.where, error)
            return []
    if isinstance(shape, Capsule):
        end, half = _primitive(Sphere(shape.radius)), shape.length / 2.0
        tube = _primitive(Cylinder(shape.radius, shape.length))
        return [(tube, 0.0), (end, half), (end, -half)]
    return [(_primitive(shape), 0.0)]


@functools.lru_cache(maxsize=256)
def _primitive(shape: Box | Cylinder | Sphere) -> _Part:
    """Return a box, or facets that enclose a cylinder or sphere and touch it."""
    from trimesh import creation

    if isinstance(shape, Box):
        box = creation.box(shape.size)
        return _Part(box.vertices, box.faces)
    if isinstance(shape, Sphere):
        ball = creation.icosphere(_SUBDIVISIONS, shape.radius)
        nearest = np.abs((ball.triangles[:, 0] * ball.face_normals).sum(axis=1)).min()
        return _Part(
            ball.vertices * (shape.radius / nearest), ball.faces, round=(shape.radius, np.inf)
        )
    wider = shape.radius / np.cos(np.pi / _SECTIONS)
    tube = creation.cylinder(wider, shape.length, sections=_SECTIONS)
    return _Part(tube.vertices, tube.faces, round=(shape.radius, shape.length / 2.0))


@functools.lru_cache(maxsize=256)
def _mesh(mesh: Mesh, state: tuple[int, int] | None) -> tuple[_Part, ...]:
    """Return the surfaces of a mesh file; as in RViz, its colours override the visual's.

    ``state`` is part of the cache's key, so that an edited file is read again.
    """
    scene = mesh_scene(mesh)
    assert mesh.path is not None
    has_own_colors = has_colors(mesh.path, scene)
    parts = []
    for surface in surfaces(scene):
        corners = np.asarray(surface.vertices, float) * mesh.scale
        # A mirrored triangle is wound the other way about.
        faces = np.asarray(surface.faces, np.intp)[:, :: -1 if np.prod(mesh.scale) < 0.0 else 1]
        colors, texture = _look(surface.visual) if has_own_colors else (None, None)
        parts.append(_Part(corners, faces, colors, None, texture))
    return tuple(parts)


def _look(visual: Any) -> tuple[Floats | None, tuple[Floats, NDArray[np.uint8]] | None]:
    """Return colours (F, 3) or (3,), and texture coordinates with their image."""
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
