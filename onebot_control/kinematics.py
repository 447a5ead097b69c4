"""Differential drive: what the wheels' turning and the body's motion have to do with each other."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class DiffDriveKinematics:
    """Two sides of wheels on one axle; the body's frame is in the middle, x forward, y left.

    Attributes:
        separation: distance between the left and the right wheels, m.
        left_radius: of the wheels on the left, m.
        right_radius: of those on the right, m.
    """

    separation: float
    left_radius: float
    right_radius: float

    def __post_init__(self) -> None:
        """Refuse what no robot has."""
        for name in ("separation", "left_radius", "right_radius"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} must be above 0, not {value}")

    def wheel_velocities(self, linear: float, angular: float) -> tuple[float, float]:
        """Return the velocities of the left and the right wheels, rad/s.

        Args:
            linear: the body's velocity forward, m/s.
            angular: the body's turning to the left, rad/s.
        """
        across = angular * self.separation / 2.0
        return (linear - across) / self.left_radius, (linear + across) / self.right_radius

    def body_motion(self, left: float, right: float) -> tuple[float, float]:
        """Return the body's way forward in m and its turn to the left in rad.

        Args:
            left: how far the left wheels have turned, rad (or rad/s, for velocities).
            right: how far the right wheels have turned.
        """
        way_left, way_right = left * self.left_radius, right * self.right_radius
        return (way_left + way_right) / 2.0, (way_right - way_left) / self.separation
