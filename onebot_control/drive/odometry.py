"""Wheel odometry: where the body is, by how far its wheels have turned."""

import math
from array import array
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from onebot_control.poses import PlanarPose, Triple

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_LEAST = 1e-6  # m; what follows from shorter lengths need not be finite
# z, roll and pitch are zero on flat ground by definition; their variances only keep estimators from
# dividing by zero.
_FLAT = 1e-6


@dataclass(frozen=True)
class DiffDriveKinematics:
    """How the wheels' turning and the body's motion depend on each other.

    Two sides of wheels are on one axle; the body's frame is in the middle, x forward, y left.
    """

    separation: float  # distance between the left and the right wheels, m
    left_radius: float  # left wheels', m
    right_radius: float  # right wheels', m

    def __post_init__(self) -> None:
        """Check that they are finite, and not too short."""
        for name in ("separation", "left_radius", "right_radius"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= _LEAST):
                raise ValueError(f"{name} must be at least {_LEAST:g} m, not {value:g} m")

    def wheel_velocities(self, linear: float, angular: float) -> tuple[float, float]:
        """Return the velocities of the left and the right wheels, rad/s, for a twist."""
        across = angular * self.separation / 2.0
        return (linear - across) / self.left_radius, (linear + across) / self.right_radius

    def body_motion(self, left: float, right: float) -> tuple[float, float]:
        """Return how far the body moves forward, m, and turns to the left, rad, by the wheels' rad.

        For velocities of wheels, rad/s, these are the body's velocities.
        """
        way_left, way_right = left * self.left_radius, right * self.right_radius
        return (way_left + way_right) / 2.0, (way_right - way_left) / self.separation


class PoseCovariance(NamedTuple):
    """Covariance of x, y (m) and yaw (rad), in the frame of the odometry."""

    xx: float = 0.0
    xy: float = 0.0
    yy: float = 0.0
    x_yaw: float = 0.0
    y_yaw: float = 0.0
    yaw_yaw: float = 0.0

    def moved(
        self, dx: float, dy: float, errors: tuple[Triple, Triple], variances: tuple[float, float]
    ) -> "PoseCovariance":
        """Return F P F' + G Q G' of a step by dx, dy, m.

        The error of the heading turns the step: F is [[1, 0, -dy], [0, 1, dx], [0, 0, 1]]. Two
        independent errors have ``variances`` (the diagonal of Q), and act on x, y and yaw as the
        columns of G, ``errors``.
        """
        xx, xy, yy, xt, yt, tt = self
        (ax, ay, at), (bx, by, bt) = errors
        p, q = variances
        # F P; its last row is the last row of P.
        left_xt, left_yt = xt - dy * tt, yt + dx * tt
        return PoseCovariance(
            xx - dy * (xt + left_xt) + p * ax * ax + q * bx * bx,
            xy - dy * yt + dx * left_xt + p * ax * ay + q * bx * by,
            yy + dx * (yt + left_yt) + p * ay * ay + q * by * by,
            left_xt + p * ax * at + q * bx * bt,
            left_yt + p * ay * at + q * by * bt,
            tt + p * at * at + q * bt * bt,
        )

    def fill(self, values: "NDArray[np.float64]") -> None:
        """Write into a message's covariance (36,), of x, y, z, roll, pitch and yaw."""
        values[0], values[7], values[35] = self.xx, self.yy, self.yaw_yaw
        values[14] = values[21] = values[28] = _FLAT
        values[1] = values[6] = self.xy
        values[5] = values[30] = self.x_yaw
        values[11] = values[31] = self.y_yaw


_EXACT = PoseCovariance()


class RollingMean:
    """The mean of the last few values, or of all while there are fewer."""

    def __init__(self, size: int) -> None:
        self._size, self._values = size, array("d")

    def add(self, value: float) -> float:
        """Add a value; return the mean."""
        values = self._values
        if len(values) == self._size:
            del values[0]
        values.append(value)
        return sum(values) / len(values)

    def resized(self, size: int) -> "RollingMean":
        """Return the same over ``size`` values, beginning with the last ones of these."""
        mean = RollingMean(size)
        mean._values.extend(self._values[-size:])
        return mean


class Odometry:
    """Pose and twist of a differential drive.

    It begins at zero with the first positions it gets, whatever they are, and uses durations only,
    never a clock: neither wheels that begin elsewhere nor a clock set back make it jump.

    The covariance of the pose is propagated as in Siegwart and Nourbakhsh, "Introduction to
    Autonomous Mobile Robots", section 5.2.4: the errors of the distances by the left and the right
    wheels are independent, and their variances are proportional to the distance.

    Attributes:
        x: m, in the odometry's frame.
        y: m.
        heading: rad, not wrapped.
        linear: velocity forward, m/s: the rolling mean, or in open loop the command.
        angular: turning to the left, rad/s.
        covariance: of the pose.
        noise: variances of the distances by the left and by the right wheels, m^2 a metre.
    """

    def __init__(self, kinematics: DiffDriveKinematics, window: int = 10) -> None:
        """Begin at zero, with a twist averaged over ``window`` updates."""
        self.kinematics, self.noise = kinematics, (0.0, 0.0)
        self._window = window
        self._wheels: tuple[float, float] | None = None
        self._since = 0.0
        self._linear, self._angular = RollingMean(window), RollingMean(window)
        self.linear = self.angular = 0.0
        self.set_pose(0.0, 0.0, 0.0)

    @property
    def pose(self) -> PlanarPose:
        """The pose, in the odometry's frame."""
        return PlanarPose(self.x, self.y, self.heading)

    def set_pose(
        self, x: float, y: float, heading: float, covariance: PoseCovariance = _EXACT
    ) -> None:
        """Go on from another pose, by default known exactly; the twist stays."""
        self.x, self.y, self.heading = x, y, heading
        self.covariance = covariance

    def reset(self) -> None:
        """Begin again at zero, with the wheels where they will next be."""
        self.set_pose(0.0, 0.0, 0.0)
        self.forget_wheels()

    def rereference_wheels(self) -> None:
        """Take the next wheel positions as the wheels' at the present pose; the twist goes on."""
        self._wheels = None

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
        last, self._wheels = self._wheels, (left, right)
        since, self._since = self._since, 0.0
        if last is not None and since > 0.0:
            self._follow(left - last[0], right - last[1], since)

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
        """Move along the arc that constant wheel velocities make.

        Its chord has the direction of its middle, and the length 2 r sin(turn / 2), r = way / turn.
        """
        half = turn / 2.0
        middle = self.heading + half
        cos, sin = math.cos(middle), math.sin(middle)
        chord = way * (math.sin(half) / half) if half else way
        dx, dy = chord * cos, chord * sin
        self.heading += turn
        self.x += dx
        self.y += dy
        if way or turn:
            self._spread(way, turn, dx, dy, cos, sin)

    def _spread(
        self, way: float, turn: float, dx: float, dy: float, cos: float, sin: float
    ) -> None:
        """Propagate the covariance over an arc: F P F' + G Q G'.

        The columns of G are how an error of the left and of the right wheels' distance moves the
        pose; ``cos`` and ``sin`` are of the heading in the middle of the arc.
        """
        separation = self.kinematics.separation
        across, (left, right) = turn * separation / 2.0, self.noise
        lever = way / (2.0 * separation)
        x, y = lever * sin, lever * cos
        errors = (
            (cos / 2.0 + x, sin / 2.0 - y, -1.0 / separation),
            (cos / 2.0 - x, sin / 2.0 + y, 1.0 / separation),
        )
        variances = left * abs(way - across), right * abs(way + across)
        covariance = self.covariance.moved(dx, dy, errors, variances)
        # Else nothing is known of the pose, and the covariance stays as it is.
        if math.isfinite(sum(covariance)):
            self.covariance = covariance
