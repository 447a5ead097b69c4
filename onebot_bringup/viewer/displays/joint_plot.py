"""Plots joint states as curves, and the limits of the joints as horizontal lines."""

import colorsys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from onebot_bringup.viewer.core.display import Display, LayoutPart, Plot
from onebot_bringup.viewer.core.inbox import MessageType, WantedTopic
from onebot_bringup.viewer.core.rerun_limits import SELDOM
from onebot_bringup.viewer.core.settings import Color, setting
from onebot_bringup.viewer.displays.curves import Curves
from onebot_description.elements.urdf import Description, Joint
from onebot_description.ros.wire.message_arrays import JointStateArrays, one_joint_state

POSITION_ENTITY = "joints/position"
VELOCITY_ENTITY = "joints/velocity"
# Each list of joint names has its own curves; more lists than this are a publisher's mistake.
_MAX_SETS = 32
_CURVE_WIDTH, _LIMIT_WIDTH = 2.0, 1.0  # points on the screen

Limits = Mapping[str, tuple[float, float]]

JOINT_STATE: MessageType[JointStateArrays] = MessageType(
    "sensor_msgs/msg/JointState", one_joint_state, lambda state: state.stamp_ns
)


@dataclass(frozen=True)
class JointPlotSettings:
    """The curves of the joints."""

    positions: bool = setting(True, "draw it")
    velocities: bool = setting(True, "draw it")
    limits: bool = setting(False, "draw it")
    window: float = setting(30.0, "seconds shown; 0: all")


class JointPlotDisplay(Display[JointPlotSettings]):
    """Plots joint_states."""

    key = "joint_plot"
    order = 1
    only_plots = True
    period_ns = SELDOM

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._limits: Limits = {}  # limits that are drawn
        self._sets: dict[tuple[str, ...], _JointSet] = {}  # each set of names has its curves
        self._count = 0  # number of sets so far
        self._has_velocities = False  # whether a velocity ever came

    def topics(self) -> Sequence[WantedTopic]:
        return [WantedTopic("joint_states", (JOINT_STATE,))]

    def apply(self, settings: JointPlotSettings) -> None:
        """Plot with or without limits; the other settings only affect the layout."""
        super().apply(settings)
        robot = self.robot.description
        joints = limited_joints(robot) if robot is not None and settings.limits else ()
        drawn = {joint.name: joint.range for joint in joints}
        if drawn == self._limits:
            return
        self.flush()
        self._limits = drawn
        self._sets.clear()  # use new entities from now on, since the rows have other lengths

    def set_robot(self) -> None:
        """Take the limits of the robot's joints."""
        self.apply(self.settings)

    def add(
        self, _topic: str, _kind: MessageType[Any], messages: Sequence[tuple[int, JointStateArrays]]
    ) -> None:
        for stamp_ns, state in messages:
            if not state.names:
                continue
            if state.names not in self._sets:
                if len(self._sets) >= _MAX_SETS:
                    continue
                colors = joint_colors(state.names, len(self._sets))
                self._sets[state.names] = _JointSet(self, self._count, colors, self._limits)
                self._count += 1
            self._has_velocities |= len(state.velocities) == len(state.names)
            self._sets[state.names].add(stamp_ns, state)

    def flush(self) -> None:
        for joints in self._sets.values():
            joints.positions.flush()
            joints.velocities.flush()

    def layout(self) -> Sequence[LayoutPart]:
        """Return the plots that have data."""
        plot, robot = self.settings, self.robot.description
        moves = robot is not None and any(joint.kind != "fixed" for joint in robot.joints)
        views = []
        if plot.positions and moves:
            entity = self.entity(POSITION_ENTITY)
            views.append(Plot(entity, "Joint positions (rad, m)", plot.window))
        if plot.velocities and self._has_velocities:
            entity = self.entity(VELOCITY_ENTITY)
            views.append(Plot(entity, "Joint velocities (rad/s, m/s)", plot.window))
        return [LayoutPart(views=tuple(views))]


class _JointSet:
    """The curves of a set of joints."""

    def __init__(
        self, display: JointPlotDisplay, number: int, colors: Mapping[str, Color], limits: Limits
    ) -> None:
        self._count = len(colors)
        limited = [name for name in colors if name in limits]
        self._edges = np.array([limits[name] for name in limited]).ravel()
        # The lines at the limits have the joint's name, too, so the legend has one entry per joint.
        edges = [name for name in limited for _ in range(2)]

        def curves(entity: str, edges: Sequence[str]) -> Curves:
            legend = rr.SeriesLines(
                names=[*colors, *edges],
                colors=[colors[name] for name in (*colors, *edges)],
                widths=[_CURVE_WIDTH] * len(colors) + [_LIMIT_WIDTH] * len(edges),
            )
            entity = display.entity(f"{entity}/{number}")
            return Curves(display.stage.recording, entity, lambda: legend)

        self.positions = curves(POSITION_ENTITY, edges)
        self.velocities = curves(VELOCITY_ENTITY, ())

    def add(self, stamp_ns: int, state: JointStateArrays) -> None:
        """Add the numbers of each joint in a message."""
        if len(state.positions) == self._count:
            self.positions.add(stamp_ns, np.concatenate([state.positions, self._edges]))
        if len(state.velocities) == self._count:
            self.velocities.add(stamp_ns, state.velocities)


def limited_joints(description: Description) -> tuple[Joint, ...]:
    """Return the joints of a robot that have limits."""
    return tuple(
        joint
        for joint in description.joints
        if joint.lower is not None and joint.upper is not None and joint.lower < joint.upper
    )


def joint_colors(names: Sequence[str], offset: int = 0) -> dict[str, Color]:
    """Return a color for each joint, easily distinguished on a dark ground (golden-angle hues).

    Args:
        names: the joints.
        offset: differs between sets of joints, so that each set has its own colors.
    """
    colors = {}
    for index, name in enumerate(names):
        hue = (0.58 + 0.381966 * (index + 3 * offset)) % 1.0
        red, green, blue = colorsys.hsv_to_rgb(hue, 0.6, 1.0)
        colors[name] = (round(255 * red), round(255 * green), round(255 * blue))
    return colors
