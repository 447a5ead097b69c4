"""Wheel odometry of any drive: pose, its covariance, and twist from the wheels' rotation."""

import math
from collections import deque
from collections.abc import Iterable, Sequence
from operator import sub
from typing import TYPE_CHECKING, NamedTuple

from onebot_control.drive.kinematics import Kinematics, PathError
from onebot_description.geometry.poses import PlanarPose, PlanarVelocity, Triple

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

# Variance of z, roll and pitch, which are zero on flat ground by definition; it keeps estimators
# from dividing by zero.
_FLAT = 1e-6


class PoseCovariance(NamedTuple):
    """Covariance of x, y (m) and yaw (rad), in the frame of the odometry."""

    xx: float = 0.0
    xy: float = 0.0
    yy: float = 0.0
    x_yaw: float = 0.0
    y_yaw: float = 0.0
    yaw_yaw: float = 0.0

    def moved(self, dx: float, dy: float, errors: Iterable[PathError]) -> "PoseCovariance":
        """Propagate this covariance P over a step: return F P F' + G Q G'.

        Siegwart and Nourbakhsh, section 5.2.4. An error of the heading rotates the step, so F is
        [[1, 0, -dy], [0, 1, dx], [0, 0, 1]].

        Args:
            dx: step in x, m.
            dy: step in y, m.
            errors: independent errors: columns of G, and variances, the diagonal of Q.
        """
        xx, xy, yy, xt, yt, tt = self
        # F P; its last row is the last row of P.
        left_xt, left_yt = xt - dy * tt, yt + dx * tt
        xx -= dy * (xt + left_xt)
        xy = xy - dy * yt + dx * left_xt
        yy += dx * (yt + left_yt)
        for x, y, yaw, variance in errors:
            along, across = variance * x, variance * y
            xx += along * x
            xy += along * y
            yy += across * y
            left_xt += along * yaw
            left_yt += across * yaw
            tt += variance * yaw * yaw
        return PoseCovariance(xx, xy, yy, left_xt, left_yt, tt)

    def fill(self, values: "NDArray[np.float64]") -> None:
        """Write it into a message's covariance: (36,), row-major, x, y, z, roll, pitch, yaw."""
        values[0], values[7], values[35] = self.xx, self.yy, self.yaw_yaw
        values[14] = values[21] = values[28] = _FLAT
        values[1] = values[6] = self.xy
        values[5] = values[30] = self.x_yaw
        values[11] = values[31] = self.y_yaw


_EXACT = PoseCovariance()


class Odometry:
    """Integrates wheel motion to pose, twist and covariance of a drive.

    The pose is zero at the first wheel positions, and no clock is read, so neither initial wheel
    positions nor a clock that is set back make it jump. Its inputs are finite, as the world checks
    after each step, and its times are above 0.

    The covariance of the pose is propagated as in Siegwart and Nourbakhsh, "Introduction to
    Autonomous Mobile Robots", section 5.2.4: the errors of the wheels' distances are independent,
    and their variances are proportional to the distance.

    Attributes:
        kinematics: converts wheel to body motion.
        x: position in the odometry frame, m.
        y: position in the odometry frame, m.
        heading: rad, not wrapped.
        twist: velocity in the robot's own axes: the rolling mean, or in open loop the command.
        covariance: covariance of the pose.
        noise: variance of each wheel's distance, m^2 per meter.
    """

    def __init__(
        self, kinematics: Kinematics, window: int = 10, noise: Sequence[float] = ()
    ) -> None:
        """Start at zero.

        Args:
            kinematics: converts wheel to body motion.
            window: number of updates that the twist is averaged over
                (velocity_rolling_window_size).
            noise: variance of each wheel's distance, m^2 per meter; empty if wheels are exact.
        """
        self.kinematics, self.noise = kinematics, noise or (0.0,) * len(kinematics.shares)
        self._wheels: Sequence[float] | None = None
        self._twists = deque[Triple](maxlen=window)  # the last updates' twists
        self.twist = PlanarVelocity()
        self.set_pose(0.0, 0.0, 0.0)

    @property
    def pose(self) -> PlanarPose:
        """The pose, in the odometry frame."""
        return PlanarPose(self.x, self.y, self.heading)

    def set_pose(
        self, x: float, y: float, heading: float, covariance: PoseCovariance = _EXACT
    ) -> None:
        """Continue from another pose (m, m, rad), by default known exactly; the twist stays."""
        self.x, self.y, self.heading = x, y, heading
        self.covariance = covariance

    def rereference_wheels(self) -> None:
        """Let the next wheel positions correspond to the current pose; the twist stays."""
        self._wheels = None

    def forget_wheels(self) -> None:
        """Re-reference the wheel positions and set the twist to zero, as after a teleport."""
        self.rereference_wheels()
        self._twists.clear()
        self.twist = PlanarVelocity()

    def set_window(self, window: int) -> None:
        """Average the twist over ``window`` updates from now on."""
        self._twists = deque(self._twists, window)

    def update_from_positions(
        self, positions: Sequence[float], dt: float, steering: Sequence[float] = ()
    ) -> None:
        """Integrate new wheel positions (rad), ``dt`` seconds after the last call."""
        last, self._wheels = self._wheels, positions
        if last is not None:
            self._follow([*map(sub, positions, last)], dt, steering)

    def update_from_velocities(
        self, velocities: Sequence[float], dt: float, steering: Sequence[float] = ()
    ) -> None:
        """Integrate wheel velocities (rad/s) over ``dt`` seconds."""
        self._follow([velocity * dt for velocity in velocities], dt, steering)

    def update_open_loop(self, twist: PlanarVelocity, dt: float) -> None:
        """Integrate a command over ``dt`` seconds."""
        linear, lateral, angular = twist
        self._integrate((linear * dt, lateral * dt, angular * dt))
        self.twist = twist

    def _follow(self, turned: Sequence[float], dt: float, steering: Sequence[float]) -> None:
        motion = self.kinematics.body_motion(turned, steering)
        self._integrate(motion)
        distance, aside, turn = motion
        self._twists.append((distance / dt, aside / dt, turn / dt))
        linear = lateral = angular = 0.0
        for forward, left, turning in self._twists:  # faster than three sums
            linear += forward
            lateral += left
            angular += turning
        count = len(self._twists)
        self.twist = PlanarVelocity(linear / count, lateral / count, angular / count)

    def _integrate(self, motion: Triple) -> None:
        """Move along the arc of constant wheel velocities.

        The chord has the heading in the middle of the arc, and the length 2 r sin(turn / 2) with
        r = distance / turn.
        """
        distance, aside, turn = motion
        half = turn / 2.0
        middle = self.heading + half
        cos, sin = math.cos(middle), math.sin(middle)
        ratio = math.sin(half) / half if half else 1.0  # chord over arc
        chord, across = distance * ratio, aside * ratio
        dx, dy = chord * cos - across * sin, chord * sin + across * cos
        self.heading += turn
        self.x += dx
        self.y += dy
        if distance or aside or turn:
            self._spread(motion, dx, dy, cos, sin)

    def _spread(self, motion: Triple, dx: float, dy: float, cos: float, sin: float) -> None:
        """Propagate the covariance over an arc: F P F' + G Q G'.

        The columns of G are the effects of an error of each wheel's distance on the pose; ``cos``
        and ``sin`` refer to the heading in the middle of the arc.
        """
        errors = self.kinematics.errors(motion, cos, sin, self.noise)
        self.covariance = self.covariance.moved(dx, dy, errors)
