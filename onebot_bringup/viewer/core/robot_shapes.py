"""Draws a robot in a Rerun recording: its shapes, each in the TF frame of its link.

Entities are ``robot/visual/<link>/<n>`` and ``robot/collision/<link>/<n>`` (separate subtrees, so
that one click shows or hides each). A shape that cannot be drawn is marked with a wireframe box at
its origin, ``.../<n>/missing``. All are static, so viewers that join late have them, too. Poses of
frames come only from /tf. Only meshes need trimesh, which takes a second to import.
"""

import math
import statistics
from collections.abc import Mapping, Sequence
from itertools import islice, product
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr

from onebot_bringup.viewer.core.columns import entity_path
from onebot_description.arrays import Floats
from onebot_description.elements.urdf import (
    Box,
    Capsule,
    Cylinder,
    Description,
    Geometry,
    Link,
    Mesh,
    Rgba,
    Shape,
    Sphere,
)
from onebot_description.errors import OneBotError, condensed, listing
from onebot_description.geometry import matrices
from onebot_description.geometry.poses import from_rpy
from onebot_description.model.robot_model import RobotModel

Rgba32 = tuple[int, int, int, int]  # sRGB and alpha

VISUAL_ENTITY = "robot/visual"
COLLISION_ENTITY = "robot/collision"

# As in RViz ("RVIZ/ShadedRed"), shapes without a color are red, so that they are noticed.
DEFAULT_COLOR: Rgba32 = (255, 0, 0, 255)
COLLISION_COLOR: Rgba32 = (255, 170, 0, 110)
# Color of the box that replaces a shape that cannot be drawn; few robots have this color.
MISSING_COLOR: Rgba32 = (255, 0, 255, 255)
_MISSING = "missing"
_MAX_REASONS = 10  # reasons named for missing shapes
_MISSING_SIZE = 0.1  # m, if the size of the robot is unknown


class RobotShapes:
    """Keeps a recording's static part equal to the robot's description."""

    def __init__(
        self, recording: rr.RecordingStream, frame_prefix: str = "", root: str = ""
    ) -> None:
        self._recording = recording
        self._prefix = frame_prefix
        self._root = root.split("/") if root else []
        # What each entity shows, to log only changes, and its archetype.
        self._drawn: dict[str, tuple[object, Any]] = {}

    def visual_of(self, link: str) -> str | None:
        """Return the entity of the first visual of ``link``; None if it has none."""
        start = entity_path(*self._root, *VISUAL_ENTITY.split("/"), link) + "/"
        return min((path for path in self._drawn if path.startswith(start)), default=None)

    def set_robot(self, robot: Description) -> list[str]:
        """Show ``robot`` in place of the previous one; log only what has changed.

        Returns:
            A sentence per reason why shapes are not drawn.
        """
        warnings = [f"{text}; not drawn" for link in robot.links for text in link.left_out]
        entities: set[str] = set()
        failures: dict[str, list[str]] = {}  # reason to links
        size = marker_size(robot)
        for link in robot.links:
            for entity, geometries in (
                (VISUAL_ENTITY, link.visuals),
                (COLLISION_ENTITY, link.collisions),
            ):
                for number, geometry in enumerate(geometries):
                    path = entity_path(*self._root, *entity.split("/"), link.name, str(number))
                    color = None if entity == VISUAL_ENTITY else COLLISION_COLOR
                    try:
                        warnings += self._draw(path, link.name, geometry, color)
                    except OneBotError as error:
                        failures.setdefault(str(error), []).append(link.name)
                        path = f"{path}/{_MISSING}"
                        self._mark(path, link.name, geometry, size)
                    entities.add(path)
        home = self._prefix + robot.root_link
        for path in set(self._drawn) - entities:
            self._erase(path, home)
        return [*condensed([*dict.fromkeys(warnings)]), *_not_drawn(failures)]

    def _draw(
        self, path: str, link: str, geometry: Geometry, color: Rgba32 | None
    ) -> Sequence[str]:
        """Draw ``geometry`` in its file's own colors, or else in ``color``; return warnings."""
        shape = geometry.shape
        what = (link, geometry, file_state(shape) if isinstance(shape, Mesh) else None)
        if self._shows(path, what):
            return ()
        if not isinstance(shape, Mesh):
            self._log(path, what, link, geometry, _solid(shape, color or _bytes(geometry.color)))
            return ()
        from onebot_bringup.viewer.core.glb import load_mesh

        asset = load_mesh(shape, file_state(shape))
        factor = None if asset.colored and color is None else color or _bytes(geometry.color)
        drawn = rr.Asset3D(contents=asset.glb, media_type="model/gltf-binary", albedo_factor=factor)
        self._log(path, what, link, geometry, drawn)
        return asset.warnings if color is None else ()

    def _mark(self, path: str, link: str, geometry: Geometry, size: float) -> None:
        """Draw a box of ``size``, m, where ``geometry`` would be; its label shows on a click."""
        what = (link, geometry, size)
        if self._shows(path, what):
            return
        name = geometry.shape.uri if isinstance(geometry.shape, Mesh) else "shape"
        radii: Any = [rr.Radius.ui_points(2.0)]
        box = rr.Boxes3D(
            half_sizes=[[size / 2] * 3],
            colors=[MISSING_COLOR],
            radii=radii,
            labels=[f"missing: {name}"],
            show_labels=False,
        )
        self._log(path, what, link, geometry, box)

    def _shows(self, path: str, what: object) -> bool:
        return path in self._drawn and self._drawn[path][0] == what

    def _log(self, path: str, what: object, link: str, geometry: Geometry, drawn: Any) -> None:
        frame = self._prefix + link
        if path in self._drawn:
            self._erase(path, frame)
        place = rr.InstancePoses3D(
            translations=[geometry.origin.xyz],
            quaternions=[rr.Quaternion(xyzw=from_rpy(geometry.origin.rpy))],
        )
        self._recording.log(path, rr.CoordinateFrame(frame), place, drawn, static=True)
        self._drawn[path] = what, type(drawn)

    def _erase(self, path: str, home: str) -> None:
        """Empty an entity; rr.Clear does not clear static data, so it is overwritten.

        The entity moves to the frame ``home``: otherwise Rerun would report its missing frame.
        """
        _, kind = self._drawn.pop(path)
        self._recording.log(path, rr.CoordinateFrame(home), kind.cleared(), static=True)


def file_state(mesh: Mesh) -> tuple[Path, int, int]:
    """Return a mesh's file, when it was last changed in ns, and its size.

    Raises:
        OneBotError: there is no such file.
    """
    if mesh.path is None:
        raise OneBotError(f"mesh {mesh.problem}")
    try:
        status = mesh.path.stat()
    except OSError as error:
        raise OneBotError(f"mesh {mesh.path}: {error.strerror}") from error
    return mesh.path, status.st_mtime_ns, status.st_size


def _solid(shape: Shape, color: Rgba32) -> Any:
    """Return the archetype of a shape that is not a mesh."""
    style: Any = {"colors": [color], "fill_mode": rr.components.FillMode.Solid}
    if isinstance(shape, Box | Sphere):
        kind = rr.Boxes3D if isinstance(shape, Box) else rr.Ellipsoids3D
        return kind.from_fields(half_sizes=[np.array(shape.size) / 2], **style)
    assert isinstance(shape, Cylinder | Capsule)
    style |= {"lengths": [shape.length], "radii": [shape.radius]}
    if isinstance(shape, Cylinder):
        return rr.Cylinders3D.from_fields(**style)
    # Rerun's capsules begin at their origin.
    return rr.Capsules3D.from_fields(translations=[[0.0, 0.0, -shape.length / 2]], **style)


def marker_size(robot: Description) -> float:
    """Return the edge, m, of the box that replaces a missing mesh, in proportion to the links."""
    lengths = [math.hypot(*joint.origin.xyz) for joint in robot.joints]
    offsets = [length for length in lengths if length > 0]
    return statistics.median(offsets) / 2 if offsets else _MISSING_SIZE


def _not_drawn(failures: Mapping[str, Sequence[str]]) -> list[str]:
    """Return a sentence for each reason why shapes are missing, with their links; the first few."""
    sentences = [
        f"link {listing(links, most=5)}: not drawn but marked with a box: {reason}"
        for reason, links in islice(failures.items(), _MAX_REASONS)
    ]
    if len(failures) > _MAX_REASONS:
        rest = len(failures) - _MAX_REASONS
        sentences.append(f"{rest} more meshes are marked: see onebot check")
    return sentences


def _bytes(color: Rgba | None) -> Rgba32:
    """Return a URDF color as bytes; they reach the screen unchanged, as in RViz."""
    if color is None:
        return DEFAULT_COLOR
    red, green, blue, alpha = (round(255 * min(max(value, 0.0), 1.0)) for value in color)
    return red, green, blue, alpha


# --- size -----------------------------------------------------------------------------------------


def robot_bounds(description: Description, poses: Mapping[str, Floats]) -> Floats | None:
    """Return the (2, 3) box around all visuals, meters, in the fixed frame; None without any.

    Args:
        description: the robot.
        poses: (4, 4) matrices of the links in the fixed frame; links not in it are left out.
    """
    size = marker_size(description)
    clouds = [
        matrices.transformed(cloud, poses[link.name])
        for link in description.links
        if link.name in poses
        for cloud in _clouds(link, size)
    ]
    return box_around(np.concatenate(clouds)) if clouds else None


def _clouds(link: Link, marker: float) -> list[Floats]:
    """Return corners (N, 3) of the boxes around each visual, meters, in the link's frame.

    Args:
        link: the link.
        marker: the edge of the box that replaces a missing mesh, meters.
    """
    clouds = []
    for geometry in link.visuals:
        try:
            clouds.append(corners(geometry))
        except OneBotError:  # was reported when the visual was drawn
            half = np.full(3, marker / 2)
            clouds.append(geometry.origin.xyz + np.array([-half, half]))
    return clouds


def corners(geometry: Geometry) -> Floats:
    """Return the (8, 3) corners of the box around ``geometry``, meters, in its link's frame."""
    shape = geometry.shape
    if isinstance(shape, Mesh):
        from onebot_bringup.viewer.core.glb import load_mesh

        low, high = load_mesh(shape, file_state(shape)).bounds
    else:
        high = np.array(shape.size) / 2
        low = -high
    local = np.array([*product(*zip(low, high, strict=True))])
    return matrices.transformed(local, matrices.of_origin(geometry.origin))


def box_around(points: Floats) -> Floats:
    """Return the (2, 3) minimum and maximum coordinates of points (N, 3)."""
    return np.array([points.min(axis=0), points.max(axis=0)])


def diagonal(bounds: Floats) -> float:
    """Return the diagonal of a (2, 3) box, meters."""
    return float(np.linalg.norm(bounds[1] - bounds[0]))


def robot_size(description: Description) -> float:
    """Return the diagonal of the box around a robot whose joints are at 0, meters.

    It is 0 without shapes, and if the links are not one tree: then only TF knows their poses.
    """
    try:
        model = RobotModel.from_description(description)
    except OneBotError:
        return 0.0
    bounds = robot_bounds(description, model.link_matrices(np.zeros(len(model.joints))))
    return 0.0 if bounds is None else diagonal(bounds)


_SHORTEST = 0.05  # share of the robot's size, so that the axes of a hundred links are visible, too
_OF_LINK = 0.75  # share of a link's size that its axes have


def axes_lengths(robot: Description, size: float) -> dict[str, float]:
    """Return suitable lengths of the axes of links, meters, by link name.

    The axes stick out of a few big links, and do not hide small ones. A link without visuals has
    its parent's length.

    Args:
        robot: the robot.
        size: its diagonal, meters.
    """
    longest = size * max(0.55 / len(robot.links) ** 0.7, _SHORTEST)
    parents = {joint.child: joint.parent for joint in robot.joints}
    marker = marker_size(robot)
    clouds = {link.name: _clouds(link, marker) for link in robot.links}
    lengths = {}
    for name in robot.link_names:
        link = name
        while not clouds[link] and link in parents:
            link = parents[link]
        length = longest
        if clouds[link]:
            length = min(longest, _OF_LINK * diagonal(box_around(np.concatenate(clouds[link]))))
        lengths[name] = round(length, 3)
    return lengths
