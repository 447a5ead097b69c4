"""The footprint and motion limits of a robot, as the planner needs them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from onebot_control.drive.controller_limits import ControllerLimits
from onebot_control.drive.speed_limiter import SpeedLimits
from onebot_description.arrays import Floats
from onebot_description.errors import OneBotError

if TYPE_CHECKING:
    from onebot_description.description import Description

_OVERHANG = 0.01  # m by which circles may extend beyond the footprint
# Default limits if a controller has none: m/s and m/s^2, rad/s and rad/s^2.
_LINEAR, _ANGULAR = (0.5, 1.0), (1.5, 3.0)
_FASTEST_TURN = 2.5  # rad/s; above it, scans of 10 Hz are hard to match
_BRAKING = 2.6  # s, maximum time to stop
_SPACING = 0.01  # m between sample points of the footprint


@dataclass(frozen=True, eq=False)
class Vehicle:
    """A robot's footprint and the limits of its motion.

    Attributes:
        footprint: (N, 2), corners of a convex polygon, counterclockwise, in the robot's frame, m.
        forward: maximum speed forward, m/s.
        backward: maximum speed backward, m/s.
        sideways: maximum lateral speed, m/s; 0: it cannot move sideways.
        turning: maximum angular velocity, rad/s.
        acceleration: of ``forward`` and ``sideways``, m/s^2.
        turning_acceleration: rad/s^2.
        minimum_radius: minimum turning radius, m; 0: it can turn on the spot.
    """

    footprint: Floats
    forward: float
    backward: float
    sideways: float
    turning: float
    acceleration: float
    turning_acceleration: float
    minimum_radius: float = 0.0

    @property
    def half_width(self) -> float:
        """Half the width of the narrowest gap that the robot can drive through, m."""
        across = np.abs(self.footprint).max(axis=0)
        return float(across.min() if self.sideways else across[1])

    @property
    def radius(self) -> float:
        """Radius of the circle that the robot covers when it turns on the spot, m."""
        return float(np.hypot(*self.footprint.T).max())

    def circles(self) -> tuple[Floats, Floats]:
        """Return centers (N, 2) and radii (N,), m, of circles that together cover the footprint.

        They extend at most 10 mm beyond it. The selection is greedy: the edge point with the
        fewest covering circles gets the one that covers the most uncovered points.
        """
        start, edge = self.footprint, np.roll(self.footprint, -1, axis=0) - self.footprint
        length = np.hypot(*edge.T)
        share = np.arange(0.0, 1.0, _SPACING / length.max())[:, None, None]
        rim = (start + share * edge).reshape(-1, 2)
        low, high = self.footprint.min(axis=0), self.footprint.max(axis=0)
        step = max(_SPACING, float((high - low).min()) / 40.0)
        lines = (np.arange(a + step / 2.0, b, step) for a, b in zip(low, high, strict=True))
        inner = np.stack(np.meshgrid(*lines), axis=-1).reshape(-1, 2)
        away = inner[:, None] - start
        depth = ((edge[:, 0] * away[..., 1] - edge[:, 1] * away[..., 0]) / length).min(axis=1)
        inner, depth = inner[depth > 0.0], depth[depth > 0.0] + _OVERHANG
        covered = np.hypot(*(rim[:, None] - inner).transpose(2, 0, 1)) <= depth
        left, chosen = covered.any(axis=1), list[int]()
        while left.any():
            hardest = np.where(left, covered.sum(axis=1), len(inner) + 1).argmin()
            gains = covered[hardest] * (covered[left].sum(axis=0) + depth)
            chosen.append(int(gains.argmax()))
            left &= ~covered[:, chosen[-1]]
        return inner[chosen], depth[chosen]


def vehicle_of(description: "Description", controllers: Sequence[ControllerLimits]) -> Vehicle:
    """Return a robot's footprint, with the strictest limits of its controllers.

    Raises:
        OneBotError: the robot has no shapes.
    """
    forward, acceleration = _strictest([limit.linear for limit in controllers], *_LINEAR)
    forward = min(forward, _BRAKING * acceleration)
    sides = [limit.lateral for limit in controllers if limit.lateral is not None]
    sideways = _strictest(sides, *_LINEAR)[0] if sides else 0.0
    turning, turning_acceleration = _strictest([limit.angular for limit in controllers], *_ANGULAR)
    reverses = [-limit.linear.min_velocity for limit in controllers]
    backward = min([0.5 * forward, *(limit for limit in reverses if math.isfinite(limit))])
    return Vehicle(
        footprint_of(description),
        forward=forward,
        backward=backward,
        sideways=min(sideways, forward),
        turning=min(turning, _FASTEST_TURN),
        acceleration=acceleration,
        turning_acceleration=turning_acceleration,
        minimum_radius=max((limit.minimum_radius for limit in controllers), default=0.0),
    )


def _strictest(
    limits: Sequence[SpeedLimits], speed: float, acceleration: float
) -> tuple[float, float]:
    """Return the minimum of the limits of speed and acceleration, or the defaults without any."""
    speeds = [limit.max_velocity for limit in limits if math.isfinite(limit.max_velocity)]
    accelerations = [
        limit.max_acceleration for limit in limits if math.isfinite(limit.max_acceleration)
    ]
    return min(speeds, default=speed), min(accelerations, default=acceleration)


def footprint_of(description: "Description") -> Floats:
    """Return the convex hull of a robot's collision shapes from above, with its joints at 0.

    Returns:
        (N, 2), its corners, counterclockwise, in the frame of the root link, m.

    Raises:
        OneBotError: the robot has no shapes.
    """
    from scipy.spatial import ConvexHull, QhullError  # slow to import

    from onebot_control.sensing.solids import robot_solid

    corners = np.unique(robot_solid(description).corners[:, :2].astype(float).round(6), axis=0)
    try:
        hull = ConvexHull(corners).vertices
    except (QhullError, ValueError):  # they are on a line, or too few
        text = f"{description.source}: the robot has no shape, so it has no footprint"
        raise OneBotError(text) from None
    return np.asarray(corners[np.roll(hull, -hull.argmin())])
