"""Draws a robot in a Rerun recording: its shapes, each in the TF frame of its link.

Entities are ``robot/visual/<link>/<n>`` and ``robot/collision/<link>/<n>`` (separate subtrees, so
that one click shows or hides each). A shape that cannot be drawn is marked with a wireframe box at
its origin, ``.../<n>/missing``. All are static, so viewers that join late have them, too. Poses of
frames come only from /tf.
"""

import math
import statistics
from collections.abc import Mapping, Sequence
from itertools import islice
from typing import Any

import rerun as rr

from onebot_bringup.viewer.core.columns import entity_path
from onebot_description.elements.urdf import Description, Geometry, Mesh, Rgba
from onebot_description.errors import OneBotError, condensed, listing
from onebot_description.geometry.poses import from_rpy

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
        self._drawn: dict[str, object] = {}  # content by entity, to log only changes

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
            del self._drawn[path]
            self._erase(path, home)
        return [*condensed([*dict.fromkeys(warnings)]), *_not_drawn(failures)]

    def _draw(
        self, path: str, link: str, geometry: Geometry, color: Rgba32 | None
    ) -> Sequence[str]:
        """Draw ``geometry`` in its file's own colors, or else in ``color``; return warnings."""
        from onebot_bringup.viewer.core.glb import file_state, load_shape  # imports trimesh

        what = (link, geometry, file_state(geometry.shape))
        if self._drawn.get(path) == what:
            return ()
        asset = load_shape(geometry.shape)
        factor = None if asset.colored and color is None else color or _bytes(geometry.color)
        self._recording.log(
            path,
            rr.CoordinateFrame(self._prefix + link),
            rr.InstancePoses3D(
                translations=[geometry.origin.xyz], quaternions=[_quaternion(geometry)]
            ),
            rr.Asset3D(contents=asset.glb, media_type="model/gltf-binary", albedo_factor=factor),
            static=True,
        )
        self._drawn[path] = what
        return asset.warnings if color is None else ()

    def _mark(self, path: str, link: str, geometry: Geometry, size: float) -> None:
        """Draw a box of ``size``, m, where ``geometry`` would be; its label shows on a click."""
        what = (link, geometry, size)
        if self._drawn.get(path) == what:
            return
        name = geometry.shape.uri if isinstance(geometry.shape, Mesh) else "shape"
        radii: Any = [rr.Radius.ui_points(2.0)]
        self._recording.log(
            path,
            rr.CoordinateFrame(self._prefix + link),
            rr.Boxes3D(
                half_sizes=[[size / 2] * 3],
                centers=[geometry.origin.xyz],
                quaternions=[_quaternion(geometry)],
                colors=[MISSING_COLOR],
                radii=radii,
                labels=[f"missing: {name}"],
                show_labels=False,
            ),
            static=True,
        )
        self._drawn[path] = what

    def _erase(self, path: str, home: str) -> None:
        """Empty an entity; rr.Clear does not clear static data, so it is overwritten.

        The entity moves to the frame ``home``: otherwise Rerun would report its missing frame.
        """
        kind = rr.Boxes3D if path.endswith(f"/{_MISSING}") else rr.Asset3D
        self._recording.log(path, rr.CoordinateFrame(home), kind.cleared(), static=True)


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


def _quaternion(geometry: Geometry) -> rr.Quaternion:
    return rr.Quaternion(xyzw=from_rpy(geometry.origin.rpy))


def _bytes(color: Rgba | None) -> Rgba32:
    """Return a URDF color as bytes; they reach the screen unchanged, as in RViz."""
    if color is None:
        return DEFAULT_COLOR
    red, green, blue, alpha = (round(255 * min(max(value, 0.0), 1.0)) for value in color)
    return red, green, blue, alpha
