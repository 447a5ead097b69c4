"""Wheel odometry: where the body is, by how far its wheels have turned."""

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

# Below this turn (rad) the exact arc divides by nearly zero, and is a straight line to all digits.
_STRAIGHT = 1e-6
_LEAST = 1e-6  # m; what follows from shorter lengths need not be finite


@dataclass(frozen=True)
class DiffDriveKinematics:
    """How the wheels' turning and the body's motion depend on each other.

    Two sides of wheels are on one axle; the body's frame is in the middle, x forward, y left.
    """

    separation: float  # distance between the left and the right wheels, m
    left_radius: float  # of the wheels on the left, m
    right_radius: float  # of those on the right, m

    def __post_init__(self) -> None:
        """Check that they are finite, and not too short."""
        for name in ("separation", "left_radius", "right_radius"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= _LEAST):
                raise ValueError(f"{name} must be at least {_LEAST:g} m, not {value:g} m")

    def wheel_velocities(self, linear: float, angular: float) -> tuple[float, float]:
        """Return the velocities of the left and the right wheels, rad/s.

        Args:
            linear: the body's velocity forward, m/s.
            angular: the body's turning to the left, rad/s.
        """
        across = angular * self.separation / 2.0
        return (linear - across) / self.left_radius, (linear + across) / self.right_radius

    def body_motion(self, left: float, right: float) -> tuple[float, float]:
        """Return how far the body moves forward, m, and turns to the left, rad.

        Args:
            left: how far the left wheels have turned, rad (or rad/s, for velocities).
            right: how far the right wheels have turned.
        """
        way_left, way_right = left * self.left_radius, right * self.right_radius
        return (way_left + way_right) / 2.0, (way_right - way_left) / self.separation


class PoseCovariance(NamedTuple):
    """Of x, y (m) and yaw (rad), in the frame of the odometry."""

    xx: float
    xy: float
    yy: float
    x_yaw: float
    y_yaw: float
    yaw_yaw: float


class Step(NamedTuple):
    """A short way, along an arc."""

    dx: float  # change of the position, m
    dy: float
    way: float  # length of the arc, m, negative backwards
    cos: float  # of the heading in its middle
    sin: float


class RollingMean:
    """The mean of the last few values; of those there are, while they are fewer."""

    def __init__(self, size: int) -> None:
        self._values: deque[float] = deque(maxlen=size)

    def add(self, value: float) -> float:
        """Add a value; return the mean."""
        self._values.append(value)
        return sum(self._values) / len(self._values)

    def resized(self, size: int) -> "RollingMean":
        """Return the same over ``size`` values, beginning with the last ones of these."""
        other = RollingMean(size)
        other._values.extend(self._values)
        return other


class PoseUncertainty:
    """The covariance of a pose by wheel odometry, which grows with the distance driven.

    The model is that of Siegwart and Nourbakhsh, "Introduction to Autonomous Mobile Robots",
    section 5.2.4: the errors of the distances by the left and the right wheels are independent,
    their variances are proportional to the distance, and they are propagated to first order.

    An error of the pose is split into that of the heading, that of the position which follows from
    it (a lever times the heading's error), and the rest. The variance of the heading and the
    covariance of the rest are only added to, so that no rounding makes the whole indefinite,
    however long the way.
    """

    def __init__(self) -> None:
        self._heading = 0.0  # variance, rad^2
        self._lever = (0.0, 0.0)  # x and y, m/rad
        self._rest = (0.0, 0.0, 0.0)  # covariance xx, xy, yy of the rest of the position, m^2

    @property
    def covariance(self) -> PoseCovariance:
        """The covariance."""
        tt, (mx, my), (xx, xy, yy) = self._heading, self._lever, self._rest
        tx, ty = tt * mx, tt * my
        return PoseCovariance(xx + tx * mx, xy + tx * my, yy + ty * my, tx, ty, tt)

    def grow(self, step: Step, left: float, right: float, separation: float) -> None:
        """Follow a step.

        Args:
            step: of the pose.
            left: variance of the left wheels' distance, m^2.
            right: of that of the right wheels.
            separation: distance between left and right wheels, m.
        """
        # The error of the heading so far turns the step.
        mx, my = self._lever[0] - step.dy, self._lever[1] + step.dx
        tt, (xx, xy, yy) = self._heading, self._rest
        # Of the step's own error: the variance of the heading, its lever, and the rest, forward.
        both = left + right
        added = both / separation / separation
        if added > 0.0:
            forward = (right - left) * separation / (2.0 * both)
            nx = forward * step.cos - step.way / 2.0 * step.sin
            ny = forward * step.sin + step.way / 2.0 * step.cos
            rest = left * right / both
            # Two errors of the heading: where their levers differ, the position is off by that.
            share = added / (tt + added)
            ex, ey, apart = nx - mx, ny - my, tt * share
            xx += rest * step.cos * step.cos + apart * ex * ex
            xy += rest * step.cos * step.sin + apart * ex * ey
            yy += rest * step.sin * step.sin + apart * ey * ey
            mx, my, tt = mx + share * ex, my + share * ey, tt + added
        # Else nothing is known of the pose, and the covariance stays as it is.
        if math.isfinite(xx + yy + tt * (1.0 + mx * mx + my * my)):
            self._heading, self._lever, self._rest = tt, (mx, my), (xx, xy, yy)


class Odometry:
    """Pose and twist of a differential drive.

    It begins at zero with the first positions it gets, whatever they are, and uses durations only,
    never a clock: neither wheels that begin elsewhere nor a clock set back make it jump.

    Attributes:
        x: m, in the odometry's frame.
        y: m.
        heading: rad, not wrapped.
        linear: velocity forward, m/s: the rolling mean, or in open loop the command.
        angular: turning to the left, rad/s.
        uncertainty: of the pose.
        noise: variances of the distances by the left and by the right wheels, m^2 a metre.
    """

    def __init__(self, kinematics: DiffDriveKinematics, window: int = 10) -> None:
        """Begin at zero.

        Args:
            kinematics: of the robot; may be replaced while it drives.
            window: how many updates the twist is averaged over.
        """
        self.kinematics, self.noise = kinematics, (0.0, 0.0)
        self._window = window
        self._wheels: tuple[float, float] | None = None
        self._since = 0.0
        self._linear, self._angular = RollingMean(window), RollingMean(window)
        self.linear = self.angular = 0.0
        self.set_pose(0.0, 0.0, 0.0)

    def set_pose(self, x: float, y: float, heading: float) -> None:
        """Go on from another pose, which is known exactly; the twist stays."""
        self.x, self.y, self.heading = x, y, heading
        self.uncertainty = PoseUncertainty()

    def reset(self) -> None:
        """Begin again at zero, with the wheels where they will next be."""
        self.set_pose(0.0, 0.0, 0.0)
        self.forget_wheels()

    def rereference_wheels(self) -> None:
        """Take the next wheel positions as those of the pose so far; the twist goes on."""
        self._wheels = None
        self._since = 0.0

    def forget_wheels(self) -> None:
        """Re-reference the wheel positions and begin the twist anew, e.g. after a teleport."""
        self.rereference_wheels()
        self._linear, self._angular = RollingMean(self._window), RollingMean(self._window)
        self.linear = self.angular = 0.0

    def set_window(self, window: int) -> None:
        """Average the twist over ``window`` updates from now on."""
        self._window = window
        self._linear = self._linear.resized(window)
        self._angular = self._angular.resized(window)

    def update_from_positions(self, left: float, right: float, dt: float) -> None:
        """Follow the wheels' positions (rad), ``dt`` seconds after the last call.

        Unless both are finite they are ignored; the motion is covered by the next finite update.
        """
        self._since += dt
        if not (math.isfinite(left) and math.isfinite(right)):
            return
        before, self._wheels = self._wheels, (left, right)
        since, self._since = self._since, 0.0
        if before is not None and since > 0.0:
            self._follow(left - before[0], right - before[1], since)

    def update_from_velocities(self, left: float, right: float, dt: float) -> None:
        """Follow the wheels' velocities (rad/s) over ``dt`` seconds, unless one is not finite."""
        if math.isfinite(left) and math.isfinite(right) and dt > 0.0:
            self._follow(left * dt, right * dt, dt)

    def update_open_loop(self, linear: float, angular: float, dt: float) -> None:
        """Follow a command (m/s, rad/s) over ``dt`` seconds."""
        self._integrate(linear * dt, angular * dt)
        self.linear, self.angular = linear, angular

    def _follow(self, left: float, right: float, dt: float) -> None:
        way, turn = self.kinematics.body_motion(left, right)
        self._integrate(way, turn)
        self.linear = self._linear.add(way / dt)
        self.angular = self._angular.add(turn / dt)

    def _integrate(self, way: float, turn: float) -> None:
        """Move along the arc that constant wheel velocities make."""
        before, middle = self.heading, self.heading + turn / 2.0
        cos, sin = math.cos(middle), math.sin(middle)
        self.heading += turn
        if abs(turn) < _STRAIGHT:  # second-order Runge-Kutta: along the middle direction
            dx, dy = way * cos, way * sin
        else:
            radius = way / turn
            dx = radius * (math.sin(self.heading) - math.sin(before))
            dy = -radius * (math.cos(self.heading) - math.cos(before))
        self.x += dx
        self.y += dy
        if way or turn:
            across = turn * self.kinematics.separation / 2.0
            left, right = self.noise
            self.uncertainty.grow(
                Step(dx, dy, way, cos, sin),
                left * abs(way - across),
                right * abs(way + across),
                self.kinematics.separation,
            )
