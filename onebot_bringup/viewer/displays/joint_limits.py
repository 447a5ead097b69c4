"""How far each joint can go, by the URDF, drawn in the robot.

An arc (or, for a prismatic joint, a bar) lies in the frame of the parent link, a needle in that of
the child, so that /tf moves the needle along the arc: it is drawn once, and costs nothing after.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.displays.display import Context, Display, MessageType, WantedTopic
from onebot_bringup.viewer.settings import Color, setting
from onebot_description.description.description import Description, Joint, Triple
from onebot_description.model.quaternions import from_rpy, to_matrix

RANGES_ENTITY = "joint_ranges"
_STEP = math.radians(5.0)  # of an arc
# On the screen, whatever the zoom (points).
_ARC_WIDTH, _NEEDLE_WIDTH = 1.5, 2.0

Floats = NDArray[np.float64]
Strips = list[Floats]


@dataclass(frozen=True)
class JointRangesSettings:
    """How far each joint can go, drawn in the robot: an arc or a bar, and a needle where it is."""

    visible: bool = setting(False, "draw how far each joint can go")
    radius: float = setting(0.0, "of an arc, metres; 0 to choose it by the robot's size")


class JointLimitsDisplay(Display[JointRangesSettings]):
    """Draws the ranges of the robot's joints, and anew only when they change."""

    key = "joint_ranges"
    Settings = JointRangesSettings

    def __init__(self, context: Context) -> None:
        super().__init__(context)
        self._settings = JointRangesSettings()
        self._ranges: tuple[Joint, ...] = ()
        self._made_of: tuple[object, ...] = ()
        self._marks = RangeMarks(context.recording, context.frame_of)

    def topics(self) -> Sequence[WantedTopic]:
        """Return none: the colours of the joints are those of their curves."""
        return ()

    def apply(self, settings: JointRangesSettings) -> None:
        """Draw with these settings at the next ``flush``."""
        self._settings = settings

    def set_robot(self) -> None:
        """Take the limits of the robot's joints."""
        assert self.context.robot is not None
        self._ranges = limited_joints(self.context.robot)

    def add(self, topic: str, kind: MessageType[Any], messages: Sequence[Any]) -> None:
        """Nothing is subscribed."""

    def flush(self) -> None:
        """Draw the ranges, if something has changed."""
        if self.context.robot is None:
            return
        radius = self._settings.radius or self.context.fitting_length
        ranges = self._ranges if self._settings.visible and radius else ()
        colors = self.context.joint_colors
        made_of = (ranges, radius, len(colors))
        if made_of != self._made_of:
            self._made_of = made_of
            self._marks.show(ranges, radius, colors, self.context.home)


class RangeMarks:
    """Keeps the marks in a recording equal to the joints' ranges."""

    def __init__(self, recording: rr.RecordingStream, frame_of: Callable[[str], str]) -> None:
        self._recording = recording
        self._frame_of = frame_of
        self._drawn: dict[str, object] = {}

    def show(
        self,
        joints: Iterable[Joint],
        radius: float,
        colors: Mapping[str, Color],
        home: str,
    ) -> None:
        """Draw the marks of ``joints``, and no other; what did not change is left alone.

        Args:
            joints: those to be seen.
            radius: of an arc, metres.
            colors: of joints; one without is not drawn yet.
            home: a frame that exists.
        """
        wanted: dict[str, tuple[str, Strips, float, Color]] = {}
        for joint in joints:
            if joint.name in colors:
                color = colors[joint.name]
                scale = (joint.parent, scale_strips(joint, radius), _ARC_WIDTH, color)
                needle = (joint.child, needle_strips(joint, radius), _NEEDLE_WIDTH, color)
                wanted[_entity(joint.name, "range")] = scale
                wanted[_entity(joint.name, "hand")] = needle
        for entity in set(self._drawn) - set(wanted):
            # Static data can only be overwritten; a frame that is gone would be an error forever.
            del self._drawn[entity]
            empty = rr.LineStrips3D.cleared()
            self._recording.log(entity, rr.CoordinateFrame(home), empty, static=True)
        for entity, (link, strips, width, color) in wanted.items():
            what = (link, [strip.tolist() for strip in strips], color)
            if self._drawn.get(entity) != what:
                self._drawn[entity] = what
                radii: Any = [rr.Radius.ui_points(width)]
                lines = rr.LineStrips3D(strips, colors=[color], radii=radii)
                frame = rr.CoordinateFrame(self._frame_of(link))
                self._recording.log(entity, frame, lines, static=True)


def _entity(joint: str, part: str) -> str:
    return rr.new_entity_path([RANGES_ENTITY, joint, part]).lstrip("/")


def limited_joints(description: Description) -> tuple[Joint, ...]:
    """Return the joints that have a range."""
    return tuple(
        joint
        for joint in description.joints
        if joint.lower is not None and joint.upper is not None and joint.lower < joint.upper
    )


def limits(joint: Joint) -> tuple[float, float]:
    """Return the lower and the upper limit of one of ``limited_joints``, rad or m."""
    assert joint.lower is not None and joint.upper is not None
    return joint.lower, joint.upper


def scale_strips(joint: Joint, radius: float) -> Strips:
    """Return the arc or bar with its ends marked, (N, 3) points each, m in the parent's frame."""
    lower, upper = limits(joint)
    turn, across = to_matrix(from_rpy(joint.origin.rpy)), _across(joint.axis)
    if joint.kind == "revolute":
        # More than a turn would lie upon itself.
        upper = min(upper, lower + 2 * math.pi)
        count = max(2, math.ceil((upper - lower) / _STEP) + 1)
        rays = [_turned(across, joint.axis, q) for q in np.linspace(lower, upper, count)]
        strips = [radius * np.array(rays)]
        strips += [np.outer((0.9 * radius, 1.1 * radius), ray) for ray in (rays[0], rays[-1])]
    else:
        ends = np.outer((lower, upper), joint.axis)
        tick = 0.2 * radius * across
        strips = [ends, *(np.array([end - tick, end + tick]) for end in ends)]
    return [strip @ turn.T + np.array(joint.origin.xyz) for strip in strips]


def needle_strips(joint: Joint, radius: float) -> Strips:
    """Return what marks the present position, (N, 3) points, metres in the child's frame."""
    across = _across(joint.axis)
    if joint.kind == "revolute":  # a triangle that points at the arc from outside
        beside = np.cross(np.array(joint.axis), across)
        corners = [(1.0, 0.0), (1.28, 0.11), (1.28, -0.11), (1.0, 0.0)]
        return [radius * np.array([out * across + off * beside for out, off in corners])]
    return [np.outer((-0.3 * radius, 0.3 * radius), across)]


def _across(axis: Triple) -> Floats:
    """The direction of position zero: x, or z where x is along the axis, made square to it."""
    along = np.array(axis)
    start = np.array([1.0, 0.0, 0.0]) if abs(axis[0]) < 0.9 else np.array([0.0, 0.0, 1.0])
    across = start - (start @ along) * along
    square: Floats = across / np.linalg.norm(across)
    return square


def _turned(vector: Floats, axis: Triple, angle: float) -> Floats:
    """``vector``, square to ``axis``, turned about it (Rodrigues' formula)."""
    turned: Floats = math.cos(angle) * vector + math.sin(angle) * np.cross(np.array(axis), vector)
    return turned
