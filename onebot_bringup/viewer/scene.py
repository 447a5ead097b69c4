"""The robot in a Rerun recording: its shapes, each in the TF frame of its link.

Entities: ``robot/visual/<link>/<n>`` and ``robot/collision/<link>/<n>`` (a subtree of its own, so
that one click shows or hides it). All are static: a viewer that joins late, or opens the file
later, has them. Where a frame is comes from /tf only.
"""

from typing import Any

import rerun as rr

from onebot_bringup.viewer.shapes import file_state, load_shape
from onebot_description.description.description import Description, Geometry, Rgba
from onebot_description.errors import OneBotError
from onebot_description.model.quaternions import from_rpy

Bytes = tuple[int, int, int, int]  # sRGB and alpha

VISUAL_ENTITY = "robot/visual"
COLLISION_ENTITY = "robot/collision"

# RViz paints what has no colour red (its "RVIZ/ShadedRed"), so that it is noticed.
DEFAULT_COLOR: Bytes = (255, 0, 0, 255)
COLLISION_COLOR: Bytes = (255, 170, 0, 110)


class Scene:
    """Keeps a recording's static part equal to the robot's description."""

    def __init__(self, recording: rr.RecordingStream, frame_prefix: str = "") -> None:
        """Draw into ``recording`` the links in the frames of their names with ``frame_prefix``."""
        self._recording = recording
        self._prefix = frame_prefix
        self._drawn: dict[str, object] = {}  # entity to what lies on it, to log only changes

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
        problems = [f"{text}; not drawn" for link in robot.links for text in link.left_out]
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
            del self._drawn[path]
            self._erase(path, rr.Asset3D, home)
        return problems

    def _draw(self, path: str, link: str, geometry: Geometry, color: Bytes | None) -> None:
        """Draw ``geometry`` in its own colour, or else all of it in ``color``."""
        what = (link, geometry, file_state(geometry.shape))
        if self._drawn.get(path) == what:
            return
        asset = load_shape(geometry.shape)
        factor = None if asset.colored and color is None else color or _bytes(geometry.color)
        x, y, z, w = from_rpy(geometry.origin.rpy).tolist()
        self._recording.log(
            path,
            rr.CoordinateFrame(self.frame_of(link)),
            rr.InstancePoses3D(
                translations=[geometry.origin.xyz], quaternions=[rr.Quaternion(xyzw=(x, y, z, w))]
            ),
            rr.Asset3D(contents=asset.glb, media_type="model/gltf-binary", albedo_factor=factor),
            static=True,
        )
        self._drawn[path] = what

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
