"""Laser scans (sensor_msgs/LaserScan) as points."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from onebot_bringup.viewer.displays.drawing import by_topic
from onebot_bringup.viewer.displays.points import (
    FLAT,
    INTENSITY,
    Floats32,
    Points,
    PointsDrawing,
    PointsSettings,
)


@by_topic
@dataclass(frozen=True)
class LaserScanSettings(PointsSettings):
    """Points of laser scans."""


class LaserScanDrawing(PointsDrawing):
    """The scans of one topic."""

    key, Settings = "laser_scan", LaserScanSettings
    message_types = ("sensor_msgs/msg/LaserScan",)
    order = (INTENSITY, FLAT)
    few = True
    _directions: tuple[object, Floats32] = ((), np.empty((0, 2), np.float32))

    def points(self, message: Any) -> Points:
        """Return the points of ranges from range_min on and below range_max."""
        ranges, intensities = message.ranges, message.intensities
        if len(intensities) not in (0, len(ranges)):
            raise ValueError(f"{len(ranges)} ranges, but {len(intensities)} intensities")
        measured = (ranges >= message.range_min) & (ranges < message.range_max)
        directions = self._along(message.angle_min, message.angle_increment, len(ranges))
        if not measured.all():
            ranges, directions = ranges[measured], directions[measured]
            intensities = intensities[measured] if len(intensities) else intensities
        positions = np.zeros((len(ranges), 3), np.float32)
        np.multiply(directions, ranges[:, None], out=positions[:, :2])
        return Points(positions, {"intensity": intensities if len(intensities) else None}.get)

    def _along(self, start: float, step: float, count: int) -> Floats32:
        """Return the directions (N, 2) of the rays, which seldom change."""
        rays = (start, step, count)
        if self._directions[0] != rays:
            with np.errstate(all="ignore"):  # of what is not finite there is no point
                angles = start + step * np.arange(count)
                found = np.column_stack([np.cos(angles), np.sin(angles)]).astype(np.float32)
            self._directions = (rays, found)
        return self._directions[1]
