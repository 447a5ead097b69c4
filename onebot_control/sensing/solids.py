"""Solids: the visual shapes of links as triangles with their colours.

Round shapes have facets around them, which find the rays that may hit them; ``Rounds`` measures
where those do.
"""

import functools
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from onebot_control.physics.bodies import matrix
from onebot_control.physics.engine import logger
from onebot_description.description.description import (
    Box,
    Capsule,
    Cylinder,
    Geometry,
    Mesh,
    Rgba,
    Sphere,
)
from onebot_description.description.meshes import has_colors, mesh_scene, surfaces
from onebot_description.errors import OneBotError

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Integers = NDArray[np.int32]

_PLAIN: Rgba = (0.7, 0.7, 0.7, 1.0)  # colour of a visual without one
_SECTIONS, _SUBDIVISIONS = 64, 3  # facets around cylinders and spheres


class Rounds(NamedTuple):
    """Cylinders and spheres, exactly."""

    rotations: Floats  # (K, 3, 3), from the solid's frame to theirs
    centers: Floats  # (K, 3)
    radii: Floats  # (K,)
    halves: Floats  # (K,), half the length along z; infinite for a sphere

    @classmethod
    def of(cls, shapes: Sequence[tuple[Floats, float, float]]) -> "Rounds":
        """Return shapes of pose (4, 4), radius and half length."""
        poses = np.array([pose for pose, _, _ in shapes]).reshape(-1, 4, 4)
        radii, halves = np.array([shape[1:] for shape in shapes]).reshape(-1, 2).T
        return cls(poses[:, :3, :3].transpose(0, 2, 1), poses[:, :3, 3], radii, halves)

    def distances(self, which: Integers, origins: Singles, directions: Floats) -> Floats:
        """Return how far each ray (N, 3) goes to its shape's surface; infinite where it misses it.

        Rays are in the solid's frame; the length of a direction is its unit of distance.
        """
        turn = self.rotations[which]
        o = np.einsum("nij,nj->ni", turn, origins - self.centers[which])
        d = np.einsum("nij,nj->ni", turn, directions)
        radius, half = self.radii[which], self.halves[which]
        # |o + t d|^2 = r^2, of a cylinder without z.
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
    """A picture on some of a solid's faces."""

    first: int  # face
    places: Singles  # (n, 3, 2): of the corners of this face and those that follow, 0 to 1, upwards
    image: NDArray[np.uint8]  # (H, W, 3), from the top


class Solid(NamedTuple):
    """Triangles with their colours."""

    corners: Singles  # (N, 3), m
    faces: Integers  # (F, 3)
    colors: Singles  # (F, 3), sRGB, 0 to 1
    round_of: Integers  # (F,): which of ``rounds`` a face is a facet of; -1 for none
    rounds: Rounds
    textures: tuple[Texture, ...]

    @property
    def box(self) -> Floats:
        """Least and greatest corner (2, 3) around it, m; the origin if it has no triangles."""
        corners = self.corners if len(self.corners) else np.zeros((1, 3))
        return np.array([corners.min(axis=0), corners.max(axis=0)], float)

    @property
    def sphere(self) -> tuple[Floats, float]:
        """Centre (3,) and radius of a sphere around it."""
        center = self.box.mean(axis=0)
        return center, float(np.linalg.norm(self.corners - center, axis=1).max(initial=0.0))


class _Part(NamedTuple):
    corners: Floats
    faces: NDArray[np.intp]
    colors: Floats | None = None  # (F, 3) or (3,); None: the visual's
    round: tuple[float, float] | None = None  # radius and half length of what it is around
    texture: tuple[Floats, NDArray[np.uint8]] | None = None


def solid_of(geometries: Iterable[tuple[Geometry, Floats]]) -> Solid:
    """Return visuals at poses (4, 4) of their links as one solid; what cannot be read is logged."""
    corners, faces, colors, round_of = [], [], [], []
    rounds: list[tuple[Floats, float, float]] = []
    textures: list[Texture] = []
    corner_count = face_count = 0
    for geometry, link in geometries:
        color = geometry.color or _PLAIN
        for part, height in _parts(geometry) if color[3] > 0.0 else ():  # 0: hidden on purpose
            pose = link @ matrix(geometry.origin)
            pose[:3, 3] += height * pose[:3, 2]
            corners.append(part.corners @ pose[:3, :3].T + pose[:3, 3])
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


def _parts(geometry: Geometry) -> list[tuple[_Part, float]]:
    """Return the parts of a visual, with their heights in its frame."""
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
    """Return a shape with facets that touch it from outside."""
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
    """The surfaces of a mesh file in a ``state``; as in RViz, its colours override the visual's."""
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
    """Return colours (F, 3) or (3,), and the texture with its places at the corners."""
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
