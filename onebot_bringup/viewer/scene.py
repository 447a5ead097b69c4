"""The robot in a Rerun recording: its shapes, each in the TF frame of its link.

Entities: ``robot/visual/<link>/<n>`` and ``robot/collision/<link>/<n>`` (a subtree of its own, so
that one click shows or hides it). All are static: a viewer that joins late, or opens the file
later, has them. Where a frame is comes from /tf only.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr
import trimesh

from onebot_bringup.viewer.meshes import load_mesh, resolve, shade
from onebot_description.description.description import (
    Box,
    Capsule,
    Cylinder,
    Description,
    Geometry,
    Mesh,
    Rgba,
    Shape,
    Sphere,
)
from onebot_description.errors import OneBotError
from onebot_description.model.quaternions import from_rpy

Bytes = tuple[int, int, int, int]  # sRGB and alpha

VISUAL_ENTITY = "robot/visual"
COLLISION_ENTITY = "robot/collision"

# RViz paints what has no colour red (its "RVIZ/ShadedRed"), so that it is noticed.
DEFAULT_COLOR: Bytes = (255, 0, 0, 255)
COLLISION_COLOR: Bytes = (255, 170, 0, 110)


@dataclass(frozen=True)
class _Drawn:
    """What lies on an entity now, to log again only what has changed."""

    what: object
    archetype: type


class Scene:
    """Keeps a recording's static part equal to the robot's description."""

    def __init__(self, recording: rr.RecordingStream, frame_prefix: str = "") -> None:
        """Draw into ``recording`` the links in the frames of their names with ``frame_prefix``."""
        self._recording = recording
        self._prefix = frame_prefix
        self._drawn: dict[str, _Drawn] = {}

    def frame_of(self, link: str) -> str:
        """Return the TF frame of ``link``."""
        return self._prefix + link

    def visual_of(self, link: str) -> str | None:
        """Return the entity of the first visual of ``link``; None if it has none."""
        start = _path(*VISUAL_ENTITY.split("/"), link) + "/"
        return min((path for path in self._drawn if path.startswith(start)), default=None)

    def set_robot(self, robot: Description) -> list[str]:
        """Show ``robot`` and nothing else; what did not change is left alone.

        Returns:
            What could not be drawn, a sentence each.
        """
        problems = list(robot.warnings)
        wanted: set[str] = set()
        for link in robot.links:
            for entity, geometries in (
                (VISUAL_ENTITY, link.visuals),
                (COLLISION_ENTITY, link.collisions),
            ):
                for number, geometry in enumerate(geometries):
                    path = _path(*entity.split("/"), link.name, str(number))
                    color = None if entity == VISUAL_ENTITY else COLLISION_COLOR
                    try:
                        self._draw(path, link.name, geometry, color)
                    except OneBotError as error:
                        problems.append(f'link "{link.name}": {error}; not drawn')
                        continue
                    wanted.add(path)
        home = self.frame_of(robot.root_link)
        for path in set(self._drawn) - wanted:
            self._erase(path, self._drawn.pop(path).archetype, home)
        return problems

    def _draw(self, path: str, link: str, geometry: Geometry, color: Bytes | None) -> None:
        """Draw ``geometry`` in its own colour, or else all of it in ``color``."""
        what = (link, geometry, _modified(geometry.shape))
        old = self._drawn.get(path)
        if old is not None and old.what == what:
            return
        shape = geometry.shape
        drawn = _archetype(shape, color or _bytes(geometry.color), color is not None)
        x, y, z, w = from_rpy(geometry.origin.rpy).tolist()
        poses = rr.InstancePoses3D(
            translations=[geometry.origin.xyz],
            quaternions=[rr.Quaternion(xyzw=(x, y, z, w))],
            scales=[shape.scale if isinstance(shape, Mesh) else (1.0, 1.0, 1.0)],
        )
        frame = rr.CoordinateFrame(self.frame_of(link))
        if old is not None and old.archetype is not type(drawn):
            self._erase(path, old.archetype, self.frame_of(link))
        self._recording.log(path, frame, poses, drawn, static=True)
        self._drawn[path] = _Drawn(what, type(drawn))

    def _erase(self, path: str, archetype: Any, home: str) -> None:
        """Empty an entity. Static data cannot be cleared by rr.Clear, only be overwritten.

        The entity moves to the frame ``home``: one whose frame is gone would be reported forever.
        """
        self._recording.log(path, rr.CoordinateFrame(home), archetype.cleared(), static=True)


def _path(*parts: str) -> str:
    return rr.new_entity_path(list(parts)).lstrip("/")


def _bytes(color: Rgba | None) -> Bytes:
    """The bytes that reach the screen: URDF colours are shown as they are, as RViz does."""
    if color is None:
        return DEFAULT_COLOR
    red, green, blue, alpha = (round(255 * min(max(value, 0.0), 1.0)) for value in color)
    return red, green, blue, alpha


def _modified(shape: Shape) -> int:
    """When a mesh file was written, because the same URDF may mean a new mesh."""
    if not isinstance(shape, Mesh):
        return 0
    try:
        return resolve(shape.uri).stat().st_mtime_ns
    except OSError as error:
        raise OneBotError(f'mesh "{shape.uri}": {error.strerror}') from error


def _archetype(shape: Shape, color: Bytes, force: bool) -> Any:
    """Return what Rerun draws for ``shape``, solid, centred on its own origin.

    Args:
        shape: what to draw.
        color: for all that has none of its own.
        force: draw in ``color`` what has, too.
    """
    if isinstance(shape, Box):
        half = np.array(shape.size) / 2
        return rr.Boxes3D(half_sizes=[half], colors=[color], fill_mode="solid")
    if isinstance(shape, Mesh):
        return _asset(shape, color, force)
    # Meshes of our own: Rerun's cylinders and spheres show their facets.
    return _mesh(_tessellated(shape), color)


def _asset(mesh: Mesh, color: Bytes, force: bool) -> rr.Asset3D:
    asset = load_mesh(resolve(mesh.uri))
    factor = None if asset.colored and not force else color
    return rr.Asset3D(contents=asset.glb, media_type="model/gltf-binary", albedo_factor=factor)


def _tessellated(shape: Cylinder | Sphere | Capsule) -> trimesh.Trimesh:
    if isinstance(shape, Sphere):
        return trimesh.creation.icosphere(subdivisions=4, radius=shape.radius)
    if isinstance(shape, Capsule):
        # trimesh's capsule, like ours, is centred and its height counts without the ends.
        return trimesh.creation.capsule(radius=shape.radius, height=shape.length, count=(48, 48))
    return shade(trimesh.creation.cylinder(radius=shape.radius, height=shape.length, sections=72))


def _mesh(mesh: trimesh.Trimesh, color: Bytes) -> rr.Mesh3D:
    return rr.Mesh3D(
        vertex_positions=mesh.vertices,
        vertex_normals=mesh.vertex_normals,
        triangle_indices=mesh.faces,
        albedo_factor=color,
    )
