"""Draws a robot in a Rerun recording: its shapes, each in the TF frame of its link.

Entities are ``robot/visual/<link>/<n>`` and ``robot/collision/<link>/<n>`` (separate subtrees, so
that one click shows or hides each). All are static, so viewers that join late have them, too.
Poses of frames come from /tf only.
"""

from collections.abc import Mapping, Sequence
from itertools import islice

import rerun as rr

from onebot_bringup.viewer.core.columns import entity_path
from onebot_description.elements.description import Description, Geometry, Rgba
from onebot_description.errors import OneBotError, condensed, listing
from onebot_description.geometry.poses import from_rpy

Rgba32 = tuple[int, int, int, int]  # sRGB and alpha

VISUAL_ENTITY = "robot/visual"
COLLISION_ENTITY = "robot/collision"

# As in RViz ("RVIZ/ShadedRed"), shapes without a colour are red, so that they are noticed.
DEFAULT_COLOR: Rgba32 = (255, 0, 0, 255)
COLLISION_COLOR: Rgba32 = (255, 170, 0, 110)
_MOST_REASONS = 10  # reasons named for missing shapes


class Scene:
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
        for link in robot.links:
            for entity, geometries in (
                (VISUAL_ENTITY, link.visuals),
                (COLLISION_ENTITY, link.collisions),
            ):
                for number, geometry in enumerate(geometries):
                    path = entity_path(*self._root, *entity.split("/"), link.name, str(number))
                    color = None if entity == VISUAL_ENTITY else COLLISION_COLOR
                    try:
                        self._draw(path, link.name, geometry, color)
                    except OneBotError as error:
                        failures.setdefault(str(error), []).append(link.name)
                    else:
                        entities.add(path)
        home = self._prefix + robot.root_link
        for path in set(self._drawn) - entities:
            del self._drawn[path]
            self._erase(path, home)
        return [*condensed(warnings), *_not_drawn(failures)]

    def _draw(self, path: str, link: str, geometry: Geometry, color: Rgba32 | None) -> None:
        """Draw ``geometry`` in its file's own colours, or else in ``color``."""
        from onebot_bringup.viewer.core.shapes import file_state, load_shape  # imports trimesh

        what = (link, geometry, file_state(geometry.shape))
        if self._drawn.get(path) == what:
            return
        asset = load_shape(geometry.shape)
        factor = None if asset.colored and color is None else color or _bytes(geometry.color)
        self._recording.log(
            path,
            rr.CoordinateFrame(self._prefix + link),
            rr.InstancePoses3D(
                translations=[geometry.origin.xyz],
                quaternions=[rr.Quaternion(xyzw=from_rpy(geometry.origin.rpy))],
            ),
            rr.Asset3D(contents=asset.glb, media_type="model/gltf-binary", albedo_factor=factor),
            static=True,
        )
        self._drawn[path] = what

    def _erase(self, path: str, home: str) -> None:
        """Empty an entity; rr.Clear does not clear static data, so it is overwritten.

        The entity moves to the frame ``home``: otherwise Rerun would report its missing frame.
        """
        self._recording.log(path, rr.CoordinateFrame(home), rr.Asset3D.cleared(), static=True)


def _not_drawn(failures: Mapping[str, Sequence[str]]) -> list[str]:
    """Return a sentence for each reason why shapes are missing, with their links; the first few."""
    sentences = [
        f"link {listing(links, most=5)}: not drawn: {reason}"
        for reason, links in islice(failures.items(), _MOST_REASONS)
    ]
    if len(failures) > _MOST_REASONS:
        more = len(failures) - _MOST_REASONS
        sentences.append(f"{more} more meshes are not drawn: see onebot check")
    return sentences


def _bytes(color: Rgba | None) -> Rgba32:
    """Return a URDF colour as bytes; they reach the screen unchanged, as in RViz."""
    if color is None:
        return DEFAULT_COLOR
    red, green, blue, alpha = (round(255 * min(max(value, 0.0), 1.0)) for value in color)
    return red, green, blue, alpha
