"""The differential drive: the parameters of diff_drive_controller, and the kinematics."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from onebot_control.conventions import IN_EACH_CYCLE
from onebot_control.drive.kinematics import (
    DriveCommand,
    Kinematics,
    Share,
    check_lengths,
)
from onebot_control.drive.parameters import DriveParameters, read_from_urdf, wheel_noise
from onebot_description.geometry.poses import Triple
from onebot_description.parameters.reader import Problem, ignored, parameter

if TYPE_CHECKING:
    from onebot_control.drive.wheels.geometry import SideWheels, WheelGeometry
    from onebot_description.description import Description


class DiffDriveKinematics(Kinematics):
    """Converts between wheel and body motion of a differential drive.

    The wheels of both sides are on one axle; the body's frame is at its center, x forward, y left
    (REP-103). See Siegwart and Nourbakhsh, "Introduction to Autonomous Mobile Robots", section 3.2.
    """

    def __init__(self, separation: float, left_radius: float, right_radius: float) -> None:
        """Set the lengths.

        Args:
            separation: distance between the left and the right wheels, m.
            left_radius: radius of the left wheels, m.
            right_radius: radius of the right wheels, m.

        Raises:
            ValueError: a length is not finite, or too short.
        """
        self.separation, self.left_radius, self.right_radius = separation, left_radius, right_radius
        check_lengths(self, "separation", "left_radius", "right_radius")
        self.shares = Share(0.5, 0.0, -separation), Share(0.5, 0.0, separation)

    def command(
        self, twist: Triple, steering: Sequence[float] = (), dt: float = math.inf
    ) -> DriveCommand:
        linear, _, angular = twist
        left, right = self.paths(twist)
        wheels = left / self.left_radius, right / self.right_radius
        return DriveCommand(linear, 0.0, angular, wheels)

    def body_motion(self, turned: Sequence[float], steering: Sequence[float] = ()) -> Triple:
        left, right = turned
        left, right = left * self.left_radius, right * self.right_radius
        return (left + right) / 2.0, 0.0, (right - left) / self.separation

    def paths(self, motion: Triple) -> tuple[float, float]:
        distance, _, turn = motion
        across = turn * self.separation / 2.0
        return distance - across, distance + across


def _names() -> Any:
    description = "joints of that side's wheels; empty on both sides: found in the URDF"
    return parameter((), description, unique=True, read_only=True)


def _multiplier(what: str) -> Any:
    return parameter(1.0, f"corrects {what}", above=0.0)


@dataclass(frozen=True)
class DiffDriveParameters(DriveParameters["WheelGeometry"]):
    """diff_drive_controller's parameters."""

    left_wheel_names: tuple[str, ...] = _names()
    right_wheel_names: tuple[str, ...] = _names()
    wheel_separation: float = read_from_urdf(
        "distance between the wheels, effective for skid steer"
    )
    wheel_radius: float = read_from_urdf("radius of the driven wheels")
    wheel_separation_multiplier: float = _multiplier("wheel_separation")
    left_wheel_radius_multiplier: float = _multiplier("wheel_radius on its side")
    right_wheel_radius_multiplier: float = _multiplier("wheel_radius on its side")
    left_wheel_noise: float = wheel_noise()
    right_wheel_noise: float = wheel_noise()
    is_async: bool = ignored(False, IN_EACH_CYCLE)
    wheels_per_side: int = ignored(0, "the names are counted")

    def check(self) -> Iterator[Problem]:
        """Report sides with different numbers of wheels."""
        left, right = self.left_wheel_names, self.right_wheel_names
        if len(left) != len(right):
            text = f"{len(right)} wheels, but left_wheel_names has {len(left)}; name equally many"
            yield Problem("right_wheel_names", text)

    def noise(self, paths: int) -> Sequence[float]:
        return self.left_wheel_noise**2, self.right_wheel_noise**2

    def wheels(self, description: "Description") -> "SideWheels":
        from onebot_control.drive.wheels.geometry import SideWheels  # imports numpy

        return SideWheels(description, self.left_wheel_names, self.right_wheel_names)

    def geometry(self, wheels: "SideWheels") -> "WheelGeometry":
        return wheels.geometry(self.wheel_separation, self.wheel_radius)

    def kinematics(self, geometry: "WheelGeometry") -> DiffDriveKinematics:
        return DiffDriveKinematics(
            geometry.separation * self.wheel_separation_multiplier,
            geometry.radius * self.left_wheel_radius_multiplier,
            geometry.radius * self.right_wheel_radius_multiplier,
        )
