"""The robot in a Rerun recording: its shapes, each in the TF frame of its link.

Entities: ``robot/visual/<link>/<n>``, ``robot/collision/<link>/<n>`` (a subtree of its own, so that
one click shows or hides it) and ``frames/<frame>`` (axes and name). All are static: a viewer that
joins late, or opens the file later, has them. Where a frame stands comes from /tf only.
"""

from collections.abc import Collection, Iterable
from typing import Any

import rerun as rr

from onebot_bringup.viewer.shapes import file_state, load_shape
from onebot_description.description.description import Description, Geometry, Rgba
from onebot_description.errors import OneBotError
from onebot_description.model.quaternions import from_rpy

Bytes = tuple[int, int, int, int]  # sRGB and alpha

VISUAL_ENTITY = "robot/visual"
COLLISION_ENTITY = "robot/collision"
FRAMES_ENTITY = "frames"

# RViz paints what has no colour red (its "RVIZ/ShadedRed"), so that it is noticed.
DEFAULT_COLOR: Bytes = (255, 0, 0, 255)
COLLISION_COLOR: Bytes = (255, 170, 0, 110)


class Scene:
    """Keeps a recording's static part equal to the robot's description and its frames."""

    def __init__(
        self,
        recording: rr.RecordingStream,
        *,
        axes_length: float = 0.5,
        axes_names: bool = True,
        axes_of: Collection[str] = (),
        frame_prefix: str = "",
    ) -> None:
        """Draw into ``recording``.

        Args:
            recording: where to log.
            axes_length: length of every frame's axes, metres.
            axes_names: write the frames' names beside them.
            axes_of: draw the axes of these frames only (the prefix may be left out); empty for all.
            frame_prefix: put before link names, as robot_state_publisher's parameter of that name.
        """
        self._recording = recording
        self._axes_length = axes_length
        self._axes_names = axes_names
        self._prefix = frame_prefix
        self._axes_of = {*axes_of, *map(self.frame_of, axes_of)}
        self._drawn: dict[str, object] = {}  # entity to what lies on it, to log only changes
        self._frames: set[str] = set()

    def frame_of(self, link: str) -> str:
        """Return the TF frame of ``link``."""
        return self._prefix + link

    def entity_of(self, link: str) -> str:
        """Return an entity that moves with ``link``: its first visual, or else its axes."""
        start = _path(*VISUAL_ENTITY.split("/"), link) + "/"
        visuals = sorted(path for path in self._drawn if path.startswith(start))
        return visuals[0] if visuals else _path(FRAMES_ENTITY, self.frame_of(link))

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
            del self._drawn[path]
            self._erase(path, rr.Asset3D, home)
        self.show_frames(map(self.frame_of, robot.link_names))
        return problems

    def show_frames(self, frames: Iterable[str]) -> None:
        """Draw axes and names of ``frames`` not drawn so far."""
        wanted = self._axes_of.intersection(frames) if self._axes_of else set(frames)
        for frame in wanted - self._frames:
            self._frames.add(frame)
            self._draw_axes(frame)

    def set_axes_length(self, length: float) -> None:
        """Draw all axes anew, ``length`` metres long."""
        if length != self._axes_length:
            self._axes_length = length
            self._draw_all_axes()

    def set_axes(self, names: bool, of: Collection[str], home: str) -> None:
        """Draw the axes of the frames ``of`` (as in ``__init__``), with or without names.

        Frames left out go to the frame ``home``, which exists; ``show_frames`` draws new ones.
        """
        self._axes_of = {*of, *map(self.frame_of, of)}
        if self._axes_of:
            self.hide_frames(self._frames - self._axes_of, home)
        if names != self._axes_names:
            self._axes_names = names
            self._draw_all_axes()

    def _draw_all_axes(self) -> None:
        for frame in self._frames:
            self._draw_axes(frame)

    def _draw_axes(self, frame: str) -> None:
        axes = rr.TransformAxes3D(self._axes_length, show_frame=self._axes_names)
        path = _path(FRAMES_ENTITY, frame)
        self._recording.log(path, rr.CoordinateFrame(frame), axes, static=True)

    def hide_frames(self, frames: Iterable[str], home: str) -> None:
        """Draw ``frames`` no more; their entities go to the frame ``home``, which exists."""
        for frame in set(frames) & self._frames:
            self._frames.discard(frame)
            self._erase(_path(FRAMES_ENTITY, frame), rr.TransformAxes3D, home)

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
