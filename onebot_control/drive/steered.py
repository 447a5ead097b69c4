"""Kinematics of drives that steer front wheels: bicycles, cars and tricycles."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from onebot_description.geometry.poses import Triple, clamp, total

_LEAST = 1e-6  # m; with shorter lengths, results might not be finite
_ACROSS = 1e-9  # cosine of the angle from which a steered wheel counts as standing across
# A wheel this near to the point about which the robot turns, as a share of the radius, says
# nothing of the robot's speed.
_PIVOT = 1e-3
# How far the steering may be off before the wheels slow down, and where they slow down no more,
# rad: as steering_controllers_library.
_FAR, _FARTHEST = math.pi / 6.0, 1.5608


@dataclass(frozen=True)
class SteeredKinematics:
    """Converts between wheel and body motion of a robot that steers its front wheels.

    The body's frame is in the middle of the rear axle, x forward, y to the left (REP-103). Where
    there are two wheels, the one on the right is the first. The steering angle is that of a wheel
    in the middle of the front axle, rad to the left.

    Bicycle: both tracks are zero. Tricycle with two driven wheels: the steering track is. Car: none
    is (Ackermann steering). A tricycle whose steered wheel is driven has ``front_driven``.
    """

    wheelbase: float  # distance between the axles, m
    radius: float  # of the driven wheels, m
    traction_track: float = 0.0  # distance between the driven wheels, m; 0: there is one
    steering_track: float = 0.0  # distance between the steered wheels, m; 0: there is one
    limit: float = math.pi / 2.0  # the greatest steering angle, rad
    front_driven: bool = False  # the steered wheel is driven; then it is the only one

    def __post_init__(self) -> None:
        """Check the lengths.

        Raises:
            ValueError: a length or the limit is not finite, too short, or of another drive.
        """
        for name in ("wheelbase", "radius"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= _LEAST):
                raise ValueError(f"{name} must be at least {_LEAST:g} m, not {value:g} m")
        for name in ("traction_track", "steering_track"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise ValueError(f"{name} must be at least 0 m, not {value:g} m")
            if value and self.front_driven:
                raise ValueError(f"{name} must be 0 m if the steered wheel is driven")
        if not 0.0 < self.limit <= math.pi / 2.0:
            raise ValueError(f"limit must be above 0 and at most pi/2 rad, not {self.limit:g} rad")

    @property
    def least_radius(self) -> float:
        """The least radius of a curve, m, of the middle of the rear axle."""
        return self.wheelbase / math.tan(self.limit) if self.limit < math.pi / 2.0 else 0.0

    def steering_angle(self, linear: float, angular: float) -> float:
        """Return the steering angle, rad, for a body twist, clipped to the limit.

        Args:
            linear: forward, m/s.
            angular: velocity of turning to the left, rad/s.
        """
        across = angular * self.wheelbase
        if not across:
            return 0.0
        angle = math.atan(across / linear) if linear else math.copysign(math.pi / 2.0, across)
        return clamp(angle, -self.limit, self.limit)

    def commands(
        self, linear: float, angular: float, steering: float | None = None
    ) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return velocities of the driven wheels, rad/s, and positions of the steered ones, rad.

        The robot drives as fast as commanded, and turns as far as it can; only a driven front wheel
        that can be steered across turns it on the spot.

        Args:
            linear: forward, m/s.
            angular: velocity of turning to the left, rad/s.
            steering: the present steering angle, rad, if the wheels are to wait for the steering
                (reduce_wheel_speed_until_steering_reached).
        """
        angle = self.steering_angle(linear, angular)
        speed = self._speed(linear, angular, angle) / self.radius
        if steering is not None and abs(angle - steering) >= _FAR:
            speed *= math.cos(min(abs(angle - steering), _FARTHEST)) / math.cos(_FAR)
        bend = 0.0 if self.front_driven else self._bend(angle, self.traction_track)
        wheels = (speed * (1.0 + bend), speed * (1.0 - bend)) if self.traction_track else (speed,)
        return wheels, self._steering_positions(angle)

    def body_motion(self, traction: Sequence[float], steering: Sequence[float]) -> Triple:
        """Return travel forward and to the left (m), and left turn (rad), for wheel angles in rad.

        For wheel velocities in rad/s, the results are the body's velocities.

        Args:
            traction: angles or velocities of the driven wheels.
            steering: positions of the steered wheels, rad.
        """
        angle = self.middle_angle(steering)
        if self.front_driven:
            way = traction[0] * self.radius
            return way * math.cos(angle), 0.0, way * math.sin(angle) / self.wheelbase
        bend = self._bend(angle, self.traction_track)
        shares = (1.0 + bend, 1.0 - bend) if self.traction_track else (1.0,)
        ways = [
            wheel * self.radius / share
            for wheel, share in zip(traction, shares, strict=True)
            if abs(share) > _PIVOT
        ]
        way = total(ways) / len(ways)
        return way, 0.0, math.tan(angle) * way / self.wheelbase

    def middle_angle(self, steering: Sequence[float]) -> float:
        """Return the steering angle, rad, for positions of the steered wheels, rad."""
        if not self.steering_track:
            return steering[0]
        half = self.steering_track / 2.0
        right, left = (
            math.atan(self.wheelbase * math.tan(position) / (self.wheelbase - across))
            for position, across in (
                (steering[0], half * math.tan(steering[0])),
                (steering[1], -half * math.tan(steering[1])),
            )
        )
        return (right + left) / 2.0

    def _speed(self, linear: float, angular: float, angle: float) -> float:
        """Return the speed of a driven wheel in the middle of its axle, m/s."""
        if not self.front_driven:
            return linear
        cos = math.cos(angle)
        return linear / cos if cos > _ACROSS else abs(angular) * self.wheelbase

    def _bend(self, angle: float, track: float) -> float:
        """Return by which share a wheel at the end of the rear axle is faster than its middle."""
        return math.tan(angle) * track / (2.0 * self.wheelbase)

    def _steering_positions(self, angle: float) -> tuple[float, ...]:
        if not self.steering_track:
            return (angle,)
        ahead, across = (
            2.0 * self.wheelbase * math.cos(angle),
            self.steering_track * math.sin(angle),
        )
        side = 2.0 * self.wheelbase * math.sin(angle)
        return math.atan2(side, ahead + across), math.atan2(side, ahead - across)
