"""Draws poses as arrows or axes (PoseStamped, PoseArray, PoseWithCovarianceStamped).

A covariance is drawn as an ellipse around the position, on the ground of the message's frame, and a
sector around the heading.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import rerun as rr

from onebot_bringup.viewer.core.drawing import (
    Archetypes,
    Drawing,
    TopicSettings,
)
from onebot_bringup.viewer.core.rerun_limits import drawable
from onebot_bringup.viewer.core.settings import Color, color, one_of, setting
from onebot_description.arrays import Floats
from onebot_description.geometry.quaternions import to_matrix

ARROW, AXES, FLAT, SOLID = "Arrow", "Axes", "Arrow (Flat)", "Arrow (3D)"
AXIS_COLORS = np.array([(204, 51, 51), (51, 204, 51), (51, 102, 255)], np.uint8)
# Line of a flat arrow of length 1: its shaft, and both sides of its head.
_FLAT = np.array([(0, 0, 0), (1, 0, 0), (0.75, 0.2, 0), (1, 0, 0), (0.75, -0.2, 0)], float)
_WIDTH: Any = [rr.Radius.ui_points(0.75)]  # lines of flat arrows and outlines
_FITTING = "0: fits the robot's size"


@dataclass(frozen=True)
class PoseSettings(TopicSettings):
    """Poses as arrows along x, or as axes."""

    shape: str = setting(ARROW, "how a pose is drawn", one_of(ARROW, AXES))
    color: Color | None = setting(None, "sRGB bytes; empty: automatic", color)
    shaft_length: float = setting(0.0, f"meters; {_FITTING}")
    shaft_radius: float = setting(0.0, f"meters; {_FITTING}")
    head_length: float = setting(0.0, f"meters; {_FITTING}")
    axes_length: float = setting(0.0, f"meters; {_FITTING}")
    axes_radius: float = setting(0.0, f"meters; {_FITTING}")


L = TypeVar("L", bound=PoseSettings)


class PosesDrawing(Drawing[L]):
    """Base class of drawings of poses."""

    def shapes(self, poses: Floats) -> list[rr.AsComponents]:
        """Return the shapes of poses (N, 7): x y z in meters, and a quaternion of any length."""
        look, places, turns = self.settings, poses[:, :3], to_matrix(poses[:, 3:])
        unit = self.stage.robot_size / 2 or 1.0  # m; RViz's defaults suit a robot of 2 m
        if look.shape == AXES:
            vectors = (look.axes_length or unit) * turns.transpose(0, 2, 1).reshape(-1, 3)
            origins, colors = np.repeat(places, 3, axis=0), np.tile(AXIS_COLORS, (len(poses), 1))
            radii = [look.axes_radius or 0.1 * unit]
            return [rr.Arrows3D(vectors=vectors, origins=origins, colors=colors, radii=radii)]
        vectors = ((look.shaft_length or unit) + (look.head_length or 0.3 * unit)) * turns[:, :, 0]
        radii = [look.shaft_radius or 0.05 * unit]
        return [rr.Arrows3D(vectors=vectors, origins=places, colors=[self.color], radii=radii)]


def one_pose(pose: Any) -> Floats:
    """Return a pose as (1, 7)."""
    poses = drawable(pose.array()[None])
    if not len(poses):
        raise ValueError("its pose is not finite")
    return poses


# --- poses ----------------------------------------------------------------------------------------


class PoseDrawing(PosesDrawing[PoseSettings]):
    """The pose of one topic."""

    key = "pose"
    message_types = ("geometry_msgs/msg/PoseStamped",)
    stamped_when_sent, repeat_when_silent = False, True

    def draw(self, message: Any) -> Archetypes:
        return self.shapes(one_pose(message.pose))


@dataclass(frozen=True)
class PoseArraySettings(PoseSettings):
    """Many poses, as flat arrows along x, as arrows, or as axes."""

    shape: str = setting(FLAT, "how a pose is drawn", one_of(FLAT, SOLID, AXES))
    arrow_length: float = setting(0.3, "meters")
    shaft_length: float = setting(0.23, "meters")
    shaft_radius: float = setting(0.01, "meters")
    head_length: float = setting(0.07, "meters")
    axes_length: float = setting(0.3, "meters")
    axes_radius: float = setting(0.01, "meters")


class PoseArrayDrawing(PosesDrawing[PoseArraySettings]):
    """The poses of one topic, such as the particles of a localization."""

    key = "pose_array"
    message_types = ("geometry_msgs/msg/PoseArray",)
    stamped_when_sent, repeat_when_silent = False, True

    def draw(self, message: Any) -> Archetypes:
        """Return the shapes of the finite poses; an empty array clears them."""
        poses = drawable(message.poses.array())
        if self.settings.shape != FLAT:
            return self.shapes(poses)
        turns = to_matrix(poses[:, 3:]).transpose(0, 2, 1)
        outline = self.settings.arrow_length * _FLAT @ turns + poses[:, None, :3]
        return [rr.LineStrips3D(outline, colors=[self.color], radii=_WIDTH)]


# --- covariances ----------------------------------------------------------------------------------

# Corners of an outline, which has one more point, since it repeats the first one.
CORNERS = 48
_LARGEST_AXIS = 100.0  # a longer half axis (meters) means "unknown", such as 1e6 in a covariance
_FILL_ALPHA = 45


def ellipse_outline(covariance: Floats, sigma: float) -> Floats | None:
    """Return (49, 3) points around the position on the ground, closed, meters from the position.

    Args:
        covariance: (36,) of a pose, row by row: x, y, z in m and the angles about x, y, z in rad.
        sigma: size of the ellipse in standard deviations.

    Returns:
        None if the position is unknown: the covariance is all zero, negative, not finite or very
        large. If the position is certain in one direction, the ellipse is a line.
    """
    block = covariance.reshape(6, 6)[:2, :2] / 2
    if not np.isfinite(block).all():
        return None
    variances, axes = np.linalg.eigh(block + block.T)  # the smaller variance first
    half_axes = sigma * np.sqrt(np.maximum(variances, 0.0))
    if not 0 < half_axes[1] <= _LARGEST_AXIS:
        return None
    turns = np.linspace(0.0, 2 * math.pi, CORNERS + 1)
    outline = np.zeros((CORNERS + 1, 3))
    outline[:, :2] = half_axes * np.column_stack([np.sin(turns), np.cos(turns)]) @ axes.T
    return outline


def sector_outline(variance: float, yaw: float, sigma: float, radius: float) -> Floats | None:
    """Return (49, 3) points around a sector to either side of a heading, closed, meters.

    Args:
        variance: variance of the heading, rad2.
        yaw: the heading, rad.
        sigma: half of the sector's angle in standard deviations.
        radius: radius of the sector, meters; 0 for none.

    Returns:
        None if the heading is unknown: its variance is zero, negative or not finite.
    """
    if not (0 < variance < math.inf and math.isfinite(yaw) and sigma * radius > 0):
        return None
    half = min(math.pi, sigma * math.sqrt(variance))
    turns = yaw + np.linspace(-half, half, CORNERS - 1)
    arc = radius * np.column_stack([np.cos(turns), np.sin(turns), np.zeros_like(turns)])
    middle = np.zeros((1, 3))
    return np.concatenate([middle, arc, middle])


def outlines(pose: Floats, covariance: Floats, sigma: float, radius: float) -> list[Floats]:
    """Return the outlines that show the covariance of a pose.

    Args:
        pose: (7,) meters and a quaternion x y z w, of which only the yaw counts.
        covariance: (36,) as in ``ellipse_outline``.
        sigma: size of the shapes in standard deviations.
        radius: radius of the sector, meters; 0 for none.

    Returns:
        The outlines (49, 3) of the ellipse and the sector, meters, as far as they are known.
    """
    yaw = 2 * math.atan2(pose[5], pose[6])
    ellipse = ellipse_outline(covariance, sigma)
    sector = sector_outline(covariance[35], yaw, sigma, radius)
    return [line + pose[:3] for line in (ellipse, sector) if line is not None]


def covariance_shapes(lines: Sequence[Floats], color: Color, radii: Any) -> list[rr.AsComponents]:
    """Return the shapes of outlines (49, 3) and of the surfaces in them, half transparent."""
    fan = np.array([(0, i, i + 1) for i in range(1, CORNERS)])
    triangles = [fan + (CORNERS + 1) * number for number in range(len(lines))]
    return [
        rr.LineStrips3D(lines, colors=[color], radii=radii),
        rr.Mesh3D(
            vertex_positions=np.concatenate([np.empty((0, 3)), *lines]),
            triangle_indices=np.concatenate([np.empty((0, 3), int), *triangles]),
            albedo_factor=(*color, _FILL_ALPHA),
        ),
    ]


@dataclass(frozen=True)
class PoseWithCovarianceSettings(PoseSettings):
    """A pose as an arrow along x or as axes, with an ellipse and a sector of its covariance."""

    covariance: bool = setting(True, "draw it")
    sigma: float = setting(3.0, "size in standard deviations")
    heading: float = setting(0.5, "radius of the sector, meters; 0: none")


class PoseWithCovarianceDrawing(PosesDrawing[PoseWithCovarianceSettings]):
    """The pose of one topic, such as a localization's, and its covariance if it is known."""

    key = "pose_with_covariance"
    message_types = ("geometry_msgs/msg/PoseWithCovarianceStamped",)
    stamped_when_sent, repeat_when_silent = False, True

    def draw(self, message: Any) -> Archetypes:
        poses, look = one_pose(message.pose.pose), self.settings
        covariance = message.pose.covariance
        lines = outlines(poses[0], covariance, look.sigma, look.heading) if look.covariance else []
        return [*self.shapes(poses), *covariance_shapes(lines, self.color, _WIDTH)]
