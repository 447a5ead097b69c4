"""The mecanum drive, with the parameters of mecanum_drive_controller."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from onebot_control.conventions import CORNERS
from onebot_control.drive.holonomic import (
    HolonomicKinematics,
    HolonomicParameters,
)
from onebot_control.drive.parameters import ReferenceParameters, read_from_urdf
from onebot_description.geometry.poses import PlanarPose
from onebot_description.parameters.reader import Problem, group, ignored, parameter

if TYPE_CHECKING:
    from onebot_control.drive.wheels.finding import RunningGear
    from onebot_control.drive.wheels.rollers import MecanumWheels
    from onebot_description.description import Description

_SAME = "the states of a wheel are those of its joint"
_FORK = ", by its name in Husarion's fork"


def _wheel(corner: str, source: str = "") -> Any:
    text = f"joint of the {corner} wheel{source}; empty: found in the URDF"
    return parameter("", text, read_only=True)


def _multiplier(length: str) -> Any:
    return parameter(1.0, f"factor of {length}", above=0.0)


@dataclass(frozen=True)
class BaseFrameOffset:
    """mecanum_drive_controller's parameters ``kinematics.base_frame_offset.*``."""

    x: float = parameter(0.0, "position of the base's frame relative to the wheels' center, m")
    y: float = parameter(0.0, "position of the base's frame relative to the wheels' center, m")
    theta: float = parameter(0.0, "heading of the base's frame relative to the wheels, rad")


@dataclass(frozen=True)
class MecanumLengths:
    """mecanum_drive_controller's parameters ``kinematics.*``."""

    wheels_radius: float = read_from_urdf("radius of the wheels")
    sum_of_robot_center_projection_on_X_Y_axis: float = read_from_urdf(  # noqa: N815 - as there
        "half the wheelbase plus half the distance between the sides"
    )
    base_frame_offset: BaseFrameOffset = group(BaseFrameOffset)


@dataclass(frozen=True)
class MecanumParameters(HolonomicParameters, ReferenceParameters[HolonomicKinematics]):
    """mecanum_drive_controller's parameters."""

    front_left_wheel_command_joint_name: str = _wheel("front left")
    front_right_wheel_command_joint_name: str = _wheel("front right")
    rear_right_wheel_command_joint_name: str = _wheel("rear right")
    rear_left_wheel_command_joint_name: str = _wheel("rear left")
    front_left_wheel_name: str = _wheel("front left", _FORK)
    front_right_wheel_name: str = _wheel("front right", _FORK)
    rear_right_wheel_name: str = _wheel("rear right", _FORK)
    rear_left_wheel_name: str = _wheel("rear left", _FORK)
    front_left_wheel_state_joint_name: str = ignored("", _SAME)
    front_right_wheel_state_joint_name: str = ignored("", _SAME)
    rear_right_wheel_state_joint_name: str = ignored("", _SAME)
    rear_left_wheel_state_joint_name: str = ignored("", _SAME)
    lengths: MecanumLengths = group(MecanumLengths, "kinematics")
    wheel_radius: float = read_from_urdf(f"radius of the wheels{_FORK}")
    wheel_separation_x: float = read_from_urdf(f"distance between the axles{_FORK}")
    wheel_separation_y: float = read_from_urdf(f"distance between the sides{_FORK}")
    wheel_radius_multiplier: float = _multiplier("wheel_radius")
    wheel_separation_x_multiplier: float = _multiplier("wheel_separation_x")
    wheel_separation_y_multiplier: float = _multiplier("wheel_separation_y")

    @property
    def _names(self) -> list[str]:
        kinds = "wheel_command_joint_name", "wheel_name"
        names_by_kind = [
            [getattr(self, f"{corner}_{kind}") for corner in CORNERS] for kind in kinds
        ]
        return next(filter(any, names_by_kind), names_by_kind[0])

    def check(self) -> Iterator[Problem]:
        """Report incomplete wheel names and separations."""
        if any(self._names):
            for corner, name in zip(CORNERS, self._names, strict=True):
                if not name:
                    text = "is missing; name the wheels at all four corners, or none"
                    yield Problem(f"{corner}_wheel_command_joint_name", text)
        if bool(self.wheel_separation_x) != bool(self.wheel_separation_y):
            text = "is given without the other; write both, or none"
            yield Problem(f"wheel_separation_{'x' if self.wheel_separation_x else 'y'}", text)

    @classmethod
    def is_found(cls, gear: "RunningGear") -> bool:
        return gear.has_rollers and all(gear.axles[wheel.name].across for wheel in gear.on_ground)

    def wheels(self, description: "Description") -> "MecanumWheels":
        from onebot_control.drive.wheels.rollers import MecanumWheels  # imports numpy

        return MecanumWheels(description, [name for name in self._names if name])

    def geometry(self, wheels: "MecanumWheels") -> HolonomicKinematics:
        lengths, offset = self.lengths, self.lengths.base_frame_offset
        radius = lengths.wheels_radius or self.wheel_radius or wheels.radius
        radius *= self.wheel_radius_multiplier
        along = self.wheel_separation_x * self.wheel_separation_x_multiplier
        across = self.wheel_separation_y * self.wheel_separation_y_multiplier
        if reach := lengths.sum_of_robot_center_projection_on_X_Y_axis or (along + across) / 2.0:
            pose = PlanarPose(offset.x, offset.y, offset.theta)
            counts = [len(corner) for corner in wheels.corners]
            return HolonomicKinematics.mecanum(radius, reach, counts, pose)
        return HolonomicKinematics(radius, wheels.rows, "mecanum")
