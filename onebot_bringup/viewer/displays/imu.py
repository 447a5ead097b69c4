"""Inertial sensors (sensor_msgs/Imu): the orientation as axes, the acceleration as an arrow."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from onebot_bringup.viewer.displays.display import LARGEST
from onebot_bringup.viewer.displays.message_display import Drawing, Look, MessageDisplay
from onebot_bringup.viewer.settings import Color, color, setting
from onebot_description.model.quaternions import to_matrix

_AXES: tuple[Color, ...] = ((255, 60, 60), (60, 220, 60), (80, 120, 255))  # x, y, z
_SLIMNESS = 40  # an axis is so many times longer than thick
_PERIOD_NS = 45_000_000  # hundreds may come in a second
_UNKNOWN = -1.0  # as the first number of a covariance: the sensor does not measure it


@dataclass(frozen=True)
class ImuLook(Look):
    """Inertial sensors."""

    axes: bool = setting(True, "draw the orientation, in the fixed frame")
    axes_scale: float = setting(0.3, "length of the axes, metres")
    acceleration: bool = setting(True, "draw the acceleration, gravity with it")
    acceleration_scale: float = setting(0.05, "metres for a metre per second squared")
    color: Color | None = setting(None, "of it, sRGB bytes; by default one of ours", color)


class ImuDrawing(Drawing[ImuLook]):
    """What one sensor measures."""

    _drawn_ns = 0  # stamp of the message drawn last

    def style(self) -> Sequence[rr.AsComponents]:
        """Return the thickness."""
        radius = max(self.look.axes_scale, 0.01) / _SLIMNESS / 2
        return [rr.Arrows3D.from_fields(radii=[radius])]

    def draw(self, message: Any) -> Sequence[rr.AsComponents]:
        """Return the arrows, in the frame of the sensor; some 20 times a second.

        Raises:
            ValueError: its orientation is none.
        """
        if 0 < self.stamp_ns - self._drawn_ns < _PERIOD_NS:
            return ()
        self._drawn_ns = self.stamp_ns
        turn = self._turn(message)
        vectors: list[Any] = []
        colors: list[Color] = []
        if self.look.axes and turn is not None:
            vectors += (self.look.axes_scale * turn.T).tolist()
            colors += _AXES
        if self.look.acceleration and message.linear_acceleration_covariance[0] != _UNKNOWN:
            measured = message.linear_acceleration
            arrow = np.array([measured.x, measured.y, measured.z])
            if not (np.abs(arrow) <= LARGEST).all():
                raise ValueError("its acceleration is not finite")
            arrow *= self.look.acceleration_scale
            # In the sensor's own axes, which are turned as it says.
            vectors.append(arrow if turn is None else turn @ arrow)
            colors.append(self.look.color or self.color)
        return [rr.Arrows3D.from_fields(vectors=vectors, colors=colors)]

    def _turn(self, message: Any) -> NDArray[np.float64] | None:
        """Return the measured orientation as a matrix (3, 3) from there to the sensor's frame.

        It is that in the fixed frame, whatever transforms say of the sensor's frame; None if it is
        not measured.

        Raises:
            ValueError: it is no quaternion.
        """
        q = message.orientation
        values = np.array([q.x, q.y, q.z, q.w])
        if message.orientation_covariance[0] == _UNKNOWN:
            return None
        length = math.hypot(*values)
        if not 0.0 < length <= LARGEST:
            raise ValueError(f"its orientation {values.tolist()} is no quaternion")
        pose = self.pose()
        measured = to_matrix(values / length)
        turn: NDArray[np.float64] = measured if pose is None else pose[:3, :3].T @ measured
        return turn


class ImuDisplay(MessageDisplay[ImuLook]):
    """Draws what inertial sensors measure."""

    key = "imu"
    Look = ImuLook
    draws = ImuDrawing
    message_types = ("sensor_msgs/msg/Imu",)
