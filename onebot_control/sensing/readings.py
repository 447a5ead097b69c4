"""What a robot measures and how it moves, as plain values."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class RobotPose:
    """The true pose of a robot's root link, or of a box's link, in the world.

    Angles are fixed-axis roll, pitch and yaw (REP-103): ``yaw`` is where it faces, from above.

    Attributes:
        x: forward of the world's origin, m.
        y: to the left of it, m.
        z: above it, m.
        roll: rad.
        pitch: rad.
        yaw: rad, -pi to pi.
    """

    x: float
    y: float
    z: float
    roll: float
    pitch: float
    yaw: float


@dataclass(frozen=True)
class PlanarVelocity:
    """A velocity of the root link in its own axes.

    Attributes:
        linear: forward, m/s.
        angular: to the left, rad/s.
    """

    linear: float
    angular: float


@dataclass(frozen=True)
class OdometryReading:
    """Pose and velocity by the wheels, as ``~/odom`` has them.

    Attributes:
        x: m, in the odometry's frame, whose origin is where the robot started.
        y: m.
        yaw: rad, -pi to pi.
        linear: forward, m/s, averaged over velocity_rolling_window_size cycles.
        angular: to the left, rad/s, likewise.
        covariance: (3, 3), of x, y and yaw: m^2, m rad, rad^2. It grows on the way.
    """

    x: float
    y: float
    yaw: float
    linear: float
    angular: float
    covariance: tuple[tuple[float, float, float], ...]


@dataclass(frozen=True)
class JointState:
    """State of one joint.

    Attributes:
        position: rad, or m for a prismatic joint; that of a wheel is never wrapped.
        velocity: rad/s, or m/s.
        effort: of its motor, Nm or N; 0 without one.
    """

    position: float
    velocity: float
    effort: float


@dataclass(frozen=True, eq=False)
class Scan:
    """Ranges that a lidar measures in a plane, as in sensor_msgs/LaserScan.

    Attributes:
        ranges: (N,), m; infinite where nothing is in range, minus infinity where it is too near.
        angles: (N,), rad, of the rays about z of the lidar; 0 is ahead, positive to the left.
        range_min: m.
        range_max: m.
    """

    ranges: NDArray[np.float32]
    angles: NDArray[np.float64]
    range_min: float
    range_max: float

    @property
    def ahead(self) -> float:
        """The range of the ray that is nearest to straight ahead, m."""
        return self.at(0.0)

    def at(self, angle: float) -> float:
        """Return the range of the ray that is nearest to an angle, m.

        Args:
            angle: rad; beyond the scan it is that of its first or last ray.
        """
        return float(self.ranges[np.abs(self.angles - angle).argmin()])


@dataclass(frozen=True, eq=False)
class ImuReading:
    """What an inertial measurement unit measures, in its own axes (REP-145).

    Attributes:
        orientation: (4,), unit quaternion x y z w; None of an IMU that measures none.
        angular_velocity: (3,), rad/s.
        linear_acceleration: (3,), m/s^2; at rest 9.81 upwards.
    """

    orientation: NDArray[np.float64] | None
    angular_velocity: NDArray[np.float64]
    linear_acceleration: NDArray[np.float64]
