"""Poses (geometry_msgs/PoseStamped and PoseArray) as arrows or axes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.displays.display import drawable
from onebot_bringup.viewer.displays.message_display import Drawing, Look, MessageDisplay
from onebot_bringup.viewer.settings import Color, color, one_of, setting
from onebot_description.model.quaternions import to_matrix

Floats = NDArray[np.float64]

ARROW, AXES, FLAT, SOLID = "Arrow", "Axes", "Arrow (Flat)", "Arrow (3D)"
AXIS_COLORS = np.array([(204, 51, 51), (51, 204, 51), (51, 102, 255)], np.uint8)
# Of a flat arrow of length 1: its shaft, and both sides of its head.
_FLAT = np.array([(0, 0, 0), (1, 0, 0), (0.75, 0.2, 0), (1, 0, 0), (0.75, -0.2, 0)], float)
_FLAT_WIDTH = 1.5  # pixels
_FITTING = "0: in proportion to the robot"


@dataclass(frozen=True)
class PoseLook(Look):
    """Poses as arrows along x, or as axes."""

    shape: str = setting(ARROW, "Arrow or Axes", one_of(ARROW, AXES))
    color: Color | None = setting(None, "of arrows, sRGB bytes; by default one of ours", color)
    shaft_length: float = setting(0.0, f"of an arrow, metres; {_FITTING}")
    shaft_radius: float = setting(0.0, f"of an arrow, metres; {_FITTING}")
    head_length: float = setting(0.0, f"of an arrow, metres; {_FITTING}")
    axes_length: float = setting(0.0, f"metres; {_FITTING}")
    axes_radius: float = setting(0.0, f"metres; {_FITTING}")


@dataclass(frozen=True)
class PoseArrayLook(PoseLook):
    """Many poses, as flat arrows along x, as arrows, or as axes."""

    shape: str = setting(FLAT, "Arrow (Flat), Arrow (3D) or Axes", one_of(FLAT, SOLID, AXES))
    arrow_length: float = setting(0.3, "of a flat arrow, metres")
    shaft_length: float = setting(0.23, "of an arrow, metres")
    shaft_radius: float = setting(0.01, "of an arrow, metres")
    head_length: float = setting(0.07, "of an arrow, metres")
    axes_length: float = setting(0.3, "metres")
    axes_radius: float = setting(0.01, "metres")


L = TypeVar("L", bound=PoseLook)


class PosesDrawing(Drawing[L]):
    """Draws poses."""

    _fitted_to = 0.0  # the robot's size when they were drawn, m

    @property
    def is_fitted(self) -> bool:
        """Whether what is drawn is in proportion to the robot."""
        return self._last is not None and self._fitted_to == self.context.robot_size

    def flush(self) -> None:
        """Log what can be shown now, and what is there anew for a robot of another size."""
        if self._last is not None and not self.is_fitted and not self._pending:
            self._pending.append(self._last)
        super().flush()

    def shapes(self, poses: Floats) -> Sequence[rr.AsComponents]:
        """Return the shapes of poses (N, 7): x y z in metres, and a quaternion of any length."""
        look, places, turns = self.look, poses[:, :3], to_matrix(poses[:, 3:])
        color = look.color or self.color
        self._fitted_to = self.context.robot_size
        unit = self._fitted_to / 2 or 1.0  # m; RViz's are for a robot of 2 m
        if isinstance(look, PoseArrayLook) and look.shape == FLAT:
            outline = look.arrow_length * _FLAT @ turns.transpose(0, 2, 1) + places[:, None]
            width: Any = [rr.Radius.ui_points(_FLAT_WIDTH / 2)]
            return [rr.LineStrips3D(outline, colors=[color], radii=width)]
        if look.shape == AXES:
            vectors = (look.axes_length or unit) * turns.transpose(0, 2, 1).reshape(-1, 3)
            origins, colors = np.repeat(places, 3, axis=0), np.tile(AXIS_COLORS, (len(poses), 1))
            radii = [look.axes_radius or 0.1 * unit]
            return [rr.Arrows3D(vectors=vectors, origins=origins, colors=colors, radii=radii)]
        vectors = ((look.shaft_length or unit) + (look.head_length or 0.3 * unit)) * turns[:, :, 0]
        radius = look.shaft_radius or 0.05 * unit
        return [rr.Arrows3D(vectors=vectors, origins=places, colors=[color], radii=[radius])]


def one_pose(pose: Any) -> Floats:
    """Return a pose as (1, 7).

    Raises:
        ValueError: it is not finite.
    """
    found = drawable(pose.array()[None])
    if not len(found):
        raise ValueError("its pose is not finite")
    return found


class PoseDrawing(PosesDrawing[PoseLook]):
    """The pose of one topic."""

    repeated = True

    def draw(self, message: Any) -> Sequence[rr.AsComponents]:
        """Return the arrow, or the axes."""
        return self.shapes(one_pose(message.pose))


class PoseDisplay(MessageDisplay[PoseLook]):
    """Draws poses."""

    key = "pose"
    Look = PoseLook
    draws = PoseDrawing
    message_types = ("geometry_msgs/msg/PoseStamped",)
    live = False


class PoseArrayDrawing(PosesDrawing[PoseArrayLook]):
    """The poses of one topic."""

    repeated = True

    def draw(self, message: Any) -> Sequence[rr.AsComponents]:
        """Return the shapes of the poses that are finite; none of an empty array."""
        return self.shapes(drawable(message.poses.array()))


class PoseArrayDisplay(MessageDisplay[PoseArrayLook]):
    """Draws many poses, such as the particles of a localization."""

    key = "pose_array"
    Look = PoseArrayLook
    draws = PoseArrayDrawing
    message_types = ("geometry_msgs/msg/PoseArray",)
    live = False
