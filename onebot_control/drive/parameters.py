"""The parameters of every drive."""

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

from onebot_control.drive.kinematics import Kinematics
from onebot_control.drive.speed_limiter import SpeedLimits
from onebot_description.errors import OneBotError
from onebot_description.parameters.reader import group, ignored, parameter

if TYPE_CHECKING:
    from onebot_control.drive.wheels.finding import RunningGear
    from onebot_control.drive.wheels.geometry import Wheels
    from onebot_description.description import Description

G = TypeVar("G")
_NOISE = 0.005  # m after 1 m; typical of a wheel on a hard floor


def variances(zeros: str = "", **rules: Any) -> Any:
    """Return a field for the diagonal of a covariance; ``zeros`` explains zeros."""
    text = f"variances of x, y, z, roll, pitch, yaw{zeros}"
    return parameter((0.0,) * 6, text, at_least=0.0, **rules)


def wheel_noise() -> Any:
    """Return a field for the error of a wheel's path."""
    text = "standard deviation of the wheels' path after 1 m, m; grows with the path's square root"
    return parameter(_NOISE, text, at_least=0.0, at_most=1.0)


def read_from_urdf(description: str, **rules: Any) -> Any:
    """Return a field for a length, m, that is read from the URDF unless it is given."""
    return parameter(0.0, f"{description}, m; 0: read from the URDF", at_least=0.0, **rules)


Diagonal = tuple[float, float, float, float, float, float]


@dataclass(frozen=True)
class DriveParameters(ABC, Generic[G]):
    """The parameters of every drive, and the wheels and kinematics that they determine.

    G is the type of the drive's lengths, a NamedTuple whose text is logged.

    Attributes:
        topics: names of the command and odometry topics, if a control file names the drive.
        steers: whether it also receives AckermannDriveStamped (speed and steering angle).
    """

    topics: ClassVar[tuple[str, str]] = "cmd_vel", "odom"
    steers: ClassVar[bool] = False

    odom_frame_id: str = parameter(
        "odom", "frame of the odometry", not_empty=True, write="the name of a frame, such as odom"
    )
    base_frame_id: str = parameter(
        "", "frame of the base, child of odom_frame_id; empty: the robot's root link"
    )
    pose_covariance_diagonal: Diagonal = variances("; zeros: they grow with the path")
    twist_covariance_diagonal: Diagonal = variances()
    open_loop: bool = parameter(False, "odometry from the commands, not from the wheels")
    position_feedback: bool = parameter(True, "odometry from wheel positions, not velocities")
    enable_odom_tf: bool = parameter(True, "also publish the odometry on /tf")
    cmd_vel_timeout: float = parameter(
        0.5,
        "time without a command until the robot brakes, s; a stamp's age counts; 0: it never does",
        at_least=0.0,
    )
    use_stamped_vel: bool = ignored(True, "Twist and TwistStamped are received")
    publish_limited_velocity: bool = parameter(False, "publish ~/cmd_vel_out")
    velocity_rolling_window_size: int = parameter(
        10, "samples over which the odometry's velocity is averaged", at_least=1
    )
    linear: SpeedLimits = group(SpeedLimits, "linear.x")
    angular: SpeedLimits = group(SpeedLimits, "angular.z")

    @property
    def timeout(self) -> float:
        """Time without a command until the robot brakes, s; 0: it never does."""
        return self.cmd_vel_timeout

    @classmethod
    def is_found(cls, gear: "RunningGear") -> bool:
        """Return whether a robot has such a drive, by its description; the first match counts."""
        return False

    @property
    def limits(self) -> Mapping[str, SpeedLimits]:
        """The limits of each axis of the drive: linear.x, linear.y and angular.z."""
        return {"linear.x": self.linear, "angular.z": self.angular}

    @abstractmethod
    def noise(self, paths: int) -> Sequence[float]:
        """Return the variance of each of the kinematics' ``paths``, m^2 per meter."""

    @abstractmethod
    def wheels(self, description: "Description") -> "Wheels":
        """Return the driven wheels: those that the parameters name, or those found in the URDF.

        Raises:
            OneBotError: there are none, or the named joints are not wheels of such a drive.
        """

    def fitted(self, wheels: Any) -> tuple[G, Kinematics]:
        """Return the geometry and the kinematics of ``wheels``.

        Raises:
            OneBotError: the description does not define the geometry, or it is unusable.
        """
        try:
            geometry = self.geometry(wheels)
            return geometry, self.kinematics(geometry)
        except ValueError as error:
            raise OneBotError(f"wheels, with their multipliers: {error}") from None

    @abstractmethod
    def geometry(self, wheels: Any) -> G:
        """Return the lengths of the drive, from the parameters or the description.

        Raises:
            OneBotError: the description does not define a length.
            ValueError: a length is unusable.
        """

    @abstractmethod
    def kinematics(self, geometry: G) -> Kinematics:
        """Return the drive's kinematics: ``geometry`` scaled by the multipliers.

        Raises:
            ValueError: a length is too short or not finite.
        """


@dataclass(frozen=True)
class AlikeWheelsParameters(DriveParameters[G]):
    """The parameters of drives whose wheels all have the same noise."""

    wheel_noise: float = wheel_noise()

    def noise(self, paths: int) -> Sequence[float]:
        return (self.wheel_noise**2,) * paths


@dataclass(frozen=True)
class ReferenceParameters(DriveParameters[G]):
    """The names that only mecanum_drive_controller and the steering controllers use."""

    topics: ClassVar[tuple[str, str]] = "reference", "odometry"

    reference_timeout: float = parameter(
        math.nan, "another name of cmd_vel_timeout, s", at_least=0.0, nan="cmd_vel_timeout"
    )

    @property
    def timeout(self) -> float:
        reference = self.reference_timeout
        return self.cmd_vel_timeout if math.isnan(reference) else reference
