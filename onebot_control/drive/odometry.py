"""Wheel odometry of a differential drive: pose and twist from the wheels' rotation."""

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from onebot_description.geometry.poses import PlanarPose, Triple, total

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_LEAST = 1e-6  # m; with shorter lengths, results might not be finite
# Variance of z, roll and pitch, which are zero on flat ground by definition: it only keeps
# estimators from dividing by zero.
_FLAT = 1e-6


@dataclass(frozen=True)
class DiffDriveKinematics:
    """Converts between wheel and body motion of a differential drive.

    The wheels of both sides are on one axle; the body's frame is in its middle, x forward, y left
    (REP-103). See Siegwart and Nourbakhsh, "Introduction to Autonomous Mobile Robots", section 3.2.
    """

    separation: float  # distance between the left and the right wheels, m
    left_radius: float  # radius of the left wheels, m
    right_radius: float  # radius of the right wheels, m

    def __post_init__(self) -> None:
        """Check the lengths.

        Raises:
            ValueError: a length is not finite, or too short.
        """
        for name in ("separation", "left_radius", "right_radius"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= _LEAST):
                raise ValueError(f"{name} must be at least {_LEAST:g} m, not {value:g} m")

    def wheel_velocities(self, linear: float, angular: float) -> tuple[float, float]:
        """Return the velocities of the left and right wheels, rad/s, for a body twist.

        Args:
            linear: forward, m/s.
            angular: velocity of turning to the left, rad/s.
        """
        across = angular * self.separation / 2.0
        return (linear - across) / self.left_radius, (linear + across) / self.right_radius

    def body_motion(self, left: float, right: float) -> tuple[float, float]:
        """Return travel (m) and left turn (rad) of the body for wheel angles in rad.

        For wheel velocities in rad/s, the results are the body's velocities.
        """
        left, right = left * self.left_radius, right * self.right_radius
        return (left + right) / 2.0, (right - left) / self.separation


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
        """Propagate this covariance P over a step: return F P F' + G Q G'.

        Siegwart and Nourbakhsh, section 5.2.4. An error of the heading rotates the step, so F is
        [[1, 0, -dy], [0, 1, dx], [0, 0, 1]].

        Args:
            dx: step in x, m.
            dy: step in y, m.
            errors: columns of G, (2, 3): how each of two independent errors acts on x, y and yaw.
            variances: variances of these errors, the diagonal of Q.
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
        """Write it into a message's covariance: (36,), row-major, x, y, z, roll, pitch, yaw."""
        values[0], values[7], values[35] = self.xx, self.yy, self.yaw_yaw
        values[14] = values[21] = values[28] = _FLAT
        values[1] = values[6] = self.xy
        values[5] = values[30] = self.x_yaw
        values[11] = values[31] = self.y_yaw


_EXACT = PoseCovariance()


class Odometry:
    """Integrates wheel motion to pose, twist and covariance of a differential drive.

    The pose is zero at the first wheel positions, whatever they are, and no clock is read: neither
    wheels that start elsewhere nor a clock that is set back make it jump. What it gets is finite,
    as the world checks after each step, and its times are above 0.

    The covariance of the pose is propagated as in Siegwart and Nourbakhsh, "Introduction to
    Autonomous Mobile Robots", section 5.2.4: the errors of the distances by the left and the right
    wheels are independent, and their variances are proportional to the distance.

    Attributes:
        kinematics: converts wheel to body motion.
        x: position in the odometry's frame, m.
        y: position in the odometry's frame, m.
        heading: rad, not wrapped.
        linear: forward velocity, m/s: the rolling mean, or in open loop the command.
        angular: velocity of turning to the left, rad/s, likewise.
        covariance: covariance of the pose.
        noise: variances of the left and right wheels' distances, m^2 per metre.
    """

    def __init__(self, kinematics: DiffDriveKinematics, window: int = 10) -> None:
        """Start at zero.

        Args:
            kinematics: converts wheel to body motion.
            window: number of updates that the twist is averaged over
                (velocity_rolling_window_size).
        """
        self.kinematics, self.noise = kinematics, (0.0, 0.0)
        self._wheels: tuple[float, float] | None = None
        # The twists of the last updates, which are averaged.
        self._linear, self._angular = deque[float](maxlen=window), deque[float](maxlen=window)
        self.linear = self.angular = 0.0
        self.set_pose(0.0, 0.0, 0.0)

    @property
    def pose(self) -> PlanarPose:
        """The pose, in the odometry's frame."""
        return PlanarPose(self.x, self.y, self.heading)

    def set_pose(
        self, x: float, y: float, heading: float, covariance: PoseCovariance = _EXACT
    ) -> None:
        """Continue from another pose (m, m, rad), by default known exactly; the twist stays."""
        self.x, self.y, self.heading = x, y, heading
        self.covariance = covariance

    def reset(self) -> None:
        """Set pose and twist to zero; the next wheel positions are the new reference."""
        self.set_pose(0.0, 0.0, 0.0)
        self.forget_wheels()

    def rereference_wheels(self) -> None:
        """Take the next wheel positions as those of the current pose; the twist stays."""
        self._wheels = None

    def forget_wheels(self) -> None:
        """Re-reference the wheel positions and set the twist to zero, as after a teleport."""
        self.rereference_wheels()
        self._linear.clear()
        self._angular.clear()
        self.linear = self.angular = 0.0

    def set_window(self, window: int) -> None:
        """Average the twist over ``window`` updates from now on."""
        self._linear, self._angular = deque(self._linear, window), deque(self._angular, window)

    def update_from_positions(self, left: float, right: float, dt: float) -> None:
        """Integrate new wheel positions (rad), ``dt`` seconds after the last call."""
        last, self._wheels = self._wheels, (left, right)
        if last is not None:
            self._follow(left - last[0], right - last[1], dt)

    def update_from_velocities(self, left: float, right: float, dt: float) -> None:
        """Integrate wheel velocities (rad/s) over ``dt`` seconds."""
        self._follow(left * dt, right * dt, dt)

    def update_open_loop(self, linear: float, angular: float, dt: float) -> None:
        """Integrate a command (m/s, rad/s) over ``dt`` seconds."""
        self._integrate(linear * dt, angular * dt)
        self.linear, self.angular = linear, angular

    def _follow(self, left: float, right: float, dt: float) -> None:
        distance, turn = self.kinematics.body_motion(left, right)
        self._integrate(distance, turn)
        self._linear.append(distance / dt)
        self._angular.append(turn / dt)
        count = len(self._linear)
        self.linear, self.angular = total(self._linear) / count, total(self._angular) / count

    def _integrate(self, distance: float, turn: float) -> None:
        """Move along the arc that constant wheel velocities make.

        The chord has the heading in the middle of the arc, and the length 2 r sin(turn / 2) with
        r = distance / turn.
        """
        half = turn / 2.0
        middle = self.heading + half
        cos, sin = math.cos(middle), math.sin(middle)
        chord = distance * (math.sin(half) / half) if half else distance
        dx, dy = chord * cos, chord * sin
        self.heading += turn
        self.x += dx
        self.y += dy
        if distance or turn:
            self._spread(distance, turn, dx, dy, cos, sin)

    def _spread(
        self, distance: float, turn: float, dx: float, dy: float, cos: float, sin: float
    ) -> None:
        """Propagate the covariance over an arc: F P F' + G Q G'.

        The columns of G are how an error of the left and of the right wheels' distance moves the
        pose; ``cos`` and ``sin`` are of the heading in the middle of the arc.
        """
        separation = self.kinematics.separation
        across, (left, right) = turn * separation / 2.0, self.noise
        lever = distance / (2.0 * separation)
        x, y = lever * sin, lever * cos
        errors = (
            (cos / 2.0 + x, sin / 2.0 - y, -1.0 / separation),
            (cos / 2.0 - x, sin / 2.0 + y, 1.0 / separation),
        )
        variances = left * abs(distance - across), right * abs(distance + across)
        covariance = self.covariance.moved(dx, dy, errors, variances)
        # If it overflows, nothing is known of the pose any more, and the covariance stays.
        if math.isfinite(sum(covariance)):
            self.covariance = covariance
