"""Draws the range of each joint, from its limits in the URDF.

An arc (for a prismatic joint, a bar) lies in the parent link's frame, a needle in the child's, so
that /tf moves the needle along the arc: both are drawn once and cost nothing afterwards.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from onebot_bringup.viewer.core.columns import entity_path
from onebot_bringup.viewer.core.display import Display
from onebot_bringup.viewer.core.settings import Color, setting
from onebot_description.arrays import Floats
from onebot_description.elements.description import Description, Joint
from onebot_description.geometry import matrices, quaternions
from onebot_description.geometry.poses import Triple, about

RANGES_ENTITY = "joint_ranges"
_STEP = math.radians(5.0)  # between two points of an arc
# Widths on the screen, at any zoom (points).
_ARC_WIDTH, _NEEDLE_WIDTH = 1.5, 2.0

Strips = list[Floats]


@dataclass(frozen=True)
class JointRangesSettings:
    """The range of each joint, drawn as an arc or a bar, and its position, drawn as a needle."""

    visible: bool = setting(False, "draw how far each joint can go")
    radius: float = setting(0.0, "metres; 0: by the robot's size")


class JointLimitsDisplay(Display[JointRangesSettings]):
    """Draws the ranges of joints in the colours of their curves; redraws them when they change."""

    key = "joint_ranges"
    order = 2

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._made_of: tuple[object, ...] = ()
        self._drawn: set[str] = set()  # entities of marks

    def flush(self) -> None:
        robot = self.robot
        if robot.description is None:
            return
        radius = self.settings.radius or robot.fitting_length
        visible = self.settings.visible and radius
        joints = limited_joints(robot.description) if visible else ()
        made_of = (joints, radius, len(robot.joint_colors))
        if made_of != self._made_of:
            self._made_of = made_of
            self._draw(joints, radius)

    def _draw(self, joints: Iterable[Joint], radius: float) -> None:
        """Draw the marks of those ``joints`` that have a colour, in place of the previous marks."""
        previous, self._drawn = self._drawn, set()
        for joint in joints:
            color = self.robot.joint_colors.get(joint.name)
            if color is not None:
                scale, needle = scale_strips(joint, radius), needle_strips(joint, radius)
                self._log(joint.name, "range", joint.parent, scale, _ARC_WIDTH, color)
                self._log(joint.name, "hand", joint.child, needle, _NEEDLE_WIDTH, color)
        home = rr.CoordinateFrame(self.robot.root_frame)
        for entity in previous - self._drawn:
            # Static data cannot be cleared but overwritten, in a frame that exists.
            self.stage.recording.log(entity, home, rr.LineStrips3D.cleared(), static=True)

    def _log(
        self, joint: str, part: str, link: str, strips: Strips, width: float, color: Color
    ) -> None:
        entity = self.entity(entity_path(RANGES_ENTITY, joint, part))
        self._drawn.add(entity)
        radii: Any = [rr.Radius.ui_points(width)]
        lines = rr.LineStrips3D(strips, colors=[color], radii=radii)
        frame = rr.CoordinateFrame(self.robot.frame_of(link))
        self.stage.recording.log(entity, frame, lines, static=True)


def limited_joints(description: Description) -> tuple[Joint, ...]:
    """Return the joints of a robot that have limits."""
    return tuple(
        joint
        for joint in description.joints
        if joint.lower is not None and joint.upper is not None and joint.lower < joint.upper
    )


def scale_strips(joint: Joint, radius: float) -> Strips:
    """Return lines of the arc or bar with end marks, (N, 3) points each, m in the parent's frame.

    Args:
        joint: one of ``limited_joints``.
        radius: radius of the arc, m.
    """
    lower, upper = joint.range
    across = _across(joint.axis)
    if joint.kind == "revolute":
        # More than one turn would overlap itself.
        upper = min(upper, lower + 2 * math.pi)
        count = max(2, math.ceil((upper - lower) / _STEP) + 1)
        turns = np.array([about(joint.axis, q) for q in np.linspace(lower, upper, count)])
        rays = quaternions.rotate(turns, across)
        strips = [radius * rays]
        strips += [np.outer((0.9 * radius, 1.1 * radius), ray) for ray in (rays[0], rays[-1])]
    else:
        ends = np.outer((lower, upper), joint.axis)
        tick = 0.2 * radius * across
        strips = [ends, *(np.array([end - tick, end + tick]) for end in ends)]
    pose = matrices.of_origin(joint.origin)
    return [matrices.transformed(strip, pose) for strip in strips]


def needle_strips(joint: Joint, radius: float) -> Strips:
    """Return lines that mark the current position, (N, 3) points each, m in the child's frame.

    Args:
        joint: one of ``limited_joints``.
        radius: radius of the arc, m.
    """
    across = _across(joint.axis)
    if joint.kind == "revolute":  # a triangle that points at the arc from outside
        beside = np.cross(np.array(joint.axis), across)
        corners = [(1.0, 0.0), (1.28, 0.11), (1.28, -0.11), (1.0, 0.0)]
        return [radius * np.array([out * across + off * beside for out, off in corners])]
    return [np.outer((-0.3 * radius, 0.3 * radius), across)]


def _across(axis: Triple) -> Floats:
    """Return the direction of position zero: x, or z if x is along the axis, made square to it."""
    along = np.array(axis)
    start = np.array([1.0, 0.0, 0.0]) if abs(axis[0]) < 0.9 else np.array([0.0, 0.0, 1.0])
    across = start - (start @ along) * along
    square: Floats = across / np.linalg.norm(across)
    return square
