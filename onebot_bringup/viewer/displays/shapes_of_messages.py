"""Displays of types drawn as a shape or two: paths, polygons, points, ranges, accelerations.

Each consists of settings and a drawing; see ``drawing``.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from onebot_bringup.viewer.core.drawing import (
    Archetypes,
    Drawing,
    History,
    TopicSettings,
)
from onebot_bringup.viewer.core.rerun_limits import LARGEST, SELDOM, drawable, is_drawable
from onebot_bringup.viewer.core.settings import Color, color, fraction, setting, signed
from onebot_description.arrays import Floats
from onebot_description.geometry.quaternions import to_matrix
from onebot_description.parameters.reader import parameter

# --- paths ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PathSettings(TopicSettings):
    """Lines along planned paths."""

    color: Color | None = setting(None, "sRGB bytes; empty: automatic", color)
    line_width: float = setting(0.02, "meters")
    height: float = setting(0.0, "meters above the poses; negative to lay it on the ground", signed)


class PathDrawing(Drawing[PathSettings]):
    """A planned path as a line; an empty path clears it."""

    key = "path"
    message_types = ("nav_msgs/msg/Path",)
    stamped_when_sent, repeat_when_silent = False, True
    period_ns = SELDOM

    def style(self) -> list[rr.AsComponents]:
        return [_strips(colors=[self.color], radii=[self.settings.line_width / 2])]

    def draw(self, message: Any) -> Archetypes:
        points = drawable(message.poses.pose.position.array()) + (0.0, 0.0, self.settings.height)
        return [_strips(strips=[points] if len(points) else [])]


_strips = rr.LineStrips3D.from_fields

# --- polygons -------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PolygonSettings(TopicSettings):
    """Polygons as closed lines."""

    color: Color | None = setting(None, "sRGB bytes; empty: automatic", color)
    width: float = setting(0.0, "meters; 0: a few pixels")


class PolygonDrawing(Drawing[PolygonSettings]):
    """A polygon, such as a robot's footprint, as a closed line; an empty polygon clears it."""

    key = "polygon"
    message_types = ("geometry_msgs/msg/PolygonStamped",)
    repeat_when_silent = True

    def style(self) -> list[rr.AsComponents]:
        # A negative radius is in pixels.
        return [_strips(colors=[self.color], radii=[self.settings.width / 2 or -1.0])]

    def draw(self, message: Any) -> Archetypes:
        points = drawable(message.polygon.points.array())
        return [_strips(strips=[np.concatenate([points, points[:1]])] if len(points) else [])]


# --- points ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PointStampedSettings(TopicSettings):
    """Points as spheres."""

    color: Color | None = setting(None, "sRGB bytes; empty: automatic", color)
    radius: float = setting(0.2, "meters")
    history_length: int = parameter(1, "points shown", at_least=1, at_most=10_000)


class PointStampedDrawing(Drawing[PointStampedSettings]):
    """The last points of one topic, such as points clicked in the page."""

    key = "point_stamped"
    message_types = ("geometry_msgs/msg/PointStamped",)
    repeat_when_silent = True

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._history = History()

    def style(self) -> list[rr.AsComponents]:
        return [rr.Points3D.from_fields(colors=[self.color], radii=[self.settings.radius])]

    def draw(self, message: Any) -> Archetypes:
        place = message.point.array()
        if not is_drawable(place):
            raise ValueError("its point is not finite")
        self._history.begin(self.frame)
        if self._last is None or message is not self._last[1]:  # not a repetition
            self._history.rows.append(place)
        places = self._history.last(self.settings.history_length)
        return [rr.Points3D.from_fields(positions=places)]


# --- ranges ---------------------------------------------------------------------------------------

_CORNERS = 32  # the corners of a cone's base
_WIDEST = math.radians(170)


@dataclass(frozen=True)
class RangeSettings(TopicSettings):
    """Cones of range sensors."""

    color: Color = setting((255, 255, 255), "sRGB bytes", color)
    alpha: float = setting(0.5, "opacity", fraction)


class RangeDrawing(Drawing[RangeSettings]):
    """A sensor's cone up to the range that it measured, as in RViz."""

    key = "range"
    message_types = ("sensor_msgs/msg/Range",)

    def style(self) -> list[rr.AsComponents]:
        """Return the color and the triangles of the cone's side and base."""
        this = np.arange(_CORNERS) + 1
        following = np.roll(this, -1)
        side = np.column_stack([np.zeros_like(this), following, this])
        base = np.column_stack([np.full_like(this, _CORNERS + 1), this, following])
        return [
            rr.Mesh3D.from_fields(
                triangle_indices=np.concatenate([side, base]),
                albedo_factor=(*self.color, round(255 * self.settings.alpha)),
                face_rendering="Front",  # otherwise the far side shines through
            )
        ]

    def draw(self, message: Any) -> Archetypes:
        """Return the cone along x; empty if nothing was detected."""
        reach, angle = displayed_range(message), float(message.field_of_view)
        if not (0.0 < angle and reach <= LARGEST):
            raise ValueError(f"its field of view is {angle:g} rad, its range {reach:g} m")
        radius = reach * math.tan(min(angle, _WIDEST) / 2)
        turns = np.linspace(0.0, 2 * math.pi, _CORNERS, endpoint=False)
        base = np.column_stack(
            [np.full_like(turns, reach), radius * np.cos(turns), radius * np.sin(turns)]
        )
        corners = np.concatenate([np.zeros((1, 3)), base, [(reach, 0.0, 0.0)]])
        return [rr.Mesh3D.from_fields(vertex_positions=corners if reach else [])]


def displayed_range(message: Any) -> float:
    """Return the length of the cone of a Range message, meters; 0 for none.

    A detector of one fixed distance (``min_range`` equals ``max_range``) reports -inf for an object
    in its range, and +inf for none.
    """
    measured, low, high = message.range, message.min_range, message.max_range
    if low <= measured <= high:
        return float(measured)
    return float(low) if low == high and measured == -math.inf else 0.0


# --- inertial sensors -----------------------------------------------------------------------------

_AXES: tuple[Color, ...] = ((255, 60, 60), (60, 220, 60), (80, 120, 255))  # x, y, z
_SLIMNESS = 40  # ratio of an axis's length to its thickness
_UNKNOWN = -1.0  # a covariance that begins with this belongs to a value that is not measured


@dataclass(frozen=True)
class ImuSettings(TopicSettings):
    """Inertial sensors."""

    axes: bool = setting(True, "draw it")
    axes_scale: float = setting(0.3, "meters")
    acceleration: bool = setting(True, "draw it")
    acceleration_scale: float = setting(0.05, "meters per m/s2")
    color: Color | None = setting(None, "sRGB bytes; empty: automatic", color)


class ImuDrawing(Drawing[ImuSettings]):
    """The orientation as axes, the acceleration as an arrow, in the frame of the sensor."""

    key = "imu"
    message_types = ("sensor_msgs/msg/Imu",)
    newest_only = True  # hundreds may arrive per second

    def style(self) -> list[rr.AsComponents]:
        radius = max(self.settings.axes_scale, 0.01) / _SLIMNESS / 2
        return [rr.Arrows3D.from_fields(radii=[radius])]

    def draw(self, message: Any) -> Archetypes:
        turn = self._turn(message)
        vectors: list[Any] = []
        colors: list[Color] = []
        if self.settings.axes and turn is not None:
            vectors += (self.settings.axes_scale * turn.T).tolist()
            colors += _AXES
        if self.settings.acceleration and message.linear_acceleration_covariance[0] != _UNKNOWN:
            measured = message.linear_acceleration.array()
            if not is_drawable(measured):
                raise ValueError("its acceleration is not finite")
            arrow = self.settings.acceleration_scale * measured
            # It is measured in the sensor's own axes, rotated by the reported orientation.
            vectors.append(arrow if turn is None else turn @ arrow)
            colors.append(self.color)
        return [rr.Arrows3D.from_fields(vectors=vectors, colors=colors)]

    def _turn(self, message: Any) -> Floats | None:
        """Return the measured orientation, a (3, 3) matrix from the sensor's axes to its frame."""
        values = message.orientation.array()
        if message.orientation_covariance[0] == _UNKNOWN:
            return None
        length = math.hypot(*values)
        if not 0.0 < length <= LARGEST:
            raise ValueError(f"its orientation {values.tolist()} is not a quaternion")
        pose = self.pose()
        measured = to_matrix(values / length)
        turn: Floats = measured if pose is None else pose[:3, :3].T @ measured
        return turn
