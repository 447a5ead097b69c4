"""Plain values of a simulated robot's state and measurements."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.geometry.poses import Transform, to_rpy
from onebot_description.parameters.arguments import checked

V = TypeVar("V")


@dataclass(frozen=True)
class RobotPose:
    """The true pose of a robot's root link, or of a box's link, in the world.

    Angles are about fixed axes (REP-103).

    Attributes:
        x: position in the world, m.
        y: position in the world, m.
        z: height above the ground, m.
        roll: rad.
        pitch: rad.
        yaw: heading seen from above, rad, -pi to pi.
    """

    x: float
    y: float
    z: float
    roll: float
    pitch: float
    yaw: float

    @classmethod
    def of(cls, transform: Transform) -> "RobotPose":
        """Return the pose of a frame whose transform to the world is given."""
        translation, rotation = transform
        return cls(*translation, *to_rpy(rotation))


@dataclass(frozen=True)
class OdometryReading:
    """Pose and velocity from wheel odometry, as in ``~/odom``.

    Attributes:
        x: position in the odometry frame, whose origin is the robot's start, m.
        y: position in the odometry frame, m.
        yaw: heading in the odometry frame, rad, -pi to pi.
        linear: forward velocity, m/s, averaged over velocity_rolling_window_size cycles.
        angular: angular velocity to the left, rad/s, averaged over the same cycles.
        covariance: (3, 3), of x, y and yaw, in m^2, m rad, rad^2. It grows with the distance.
        lateral: velocity to the left, m/s, averaged over the same cycles.
    """

    x: float
    y: float
    yaw: float
    linear: float
    angular: float
    covariance: tuple[tuple[float, float, float], ...]
    lateral: float = 0.0


@dataclass(frozen=True)
class JointState:
    """Measured state of one joint.

    Attributes:
        position: rad, or m for a prismatic joint; never wrapped.
        velocity: rad/s, or m/s.
        effort: effort of its motor, Nm or N; 0 without a motor.
    """

    position: float
    velocity: float
    effort: float


@dataclass(frozen=True, eq=False)
class Scan:
    """Ranges measured by a lidar in a plane, as in sensor_msgs/LaserScan.

    Attributes:
        ranges: (N,), m; infinite if nothing is in range, minus infinity if something is too near
            (REP-117).
        angles: (N,), of the rays about the lidar's z axis, rad; 0 is ahead, positive to the left.
        range_min: minimum range, m.
        range_max: maximum range, m.
    """

    ranges: NDArray[np.float32]
    angles: NDArray[np.float64]
    range_min: float
    range_max: float

    @property
    def ahead(self) -> float:
        """The range of the ray nearest to straight ahead, m."""
        return self.at(0.0)

    @checked
    def at(self, angle: float) -> float:
        """Return the range of the ray nearest to an angle, m.

        Args:
            angle: rad; beyond the scan, its first or last ray is used.
        """
        return float(self.ranges[np.abs(self.angles - angle).argmin()])


@dataclass(frozen=True, eq=False)
class ImuReading:
    """One measurement of an inertial measurement unit (IMU), in its own axes (REP-145).

    Attributes:
        orientation: (4,), unit quaternion x y z w; None if the IMU measures no orientation.
        angular_velocity: (3,), rad/s.
        linear_acceleration: (3,), m/s^2, including gravity: 9.81 upwards at rest.
    """

    orientation: NDArray[np.float64] | None
    angular_velocity: NDArray[np.float64]
    linear_acceleration: NDArray[np.float64]


class ByName(dict[str, V]):
    """Values by name; an unknown name raises OneBotError."""

    def __init__(self, error: str, values: Iterable[tuple[str, V]]) -> None:
        """Store the values, and the error for an unknown name, which replaces {} in it."""
        super().__init__(values)
        self._error = error

    def __missing__(self, name: str) -> V:
        names = [key or "the only one, simulation.robot" for key in self]
        text = self._error.format(f'"{name}"')
        raise OneBotError(f"{text}{did_you_mean(str(name), names)}")
