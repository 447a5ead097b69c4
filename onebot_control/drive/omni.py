"""The omni drive, with the parameters of omni_wheel_drive_controller."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from onebot_control.drive.holonomic import (
    HolonomicKinematics,
    HolonomicParameters,
)
from onebot_control.drive.parameters import Diagonal, read_from_urdf, variances
from onebot_description.parameters.reader import parameter

if TYPE_CHECKING:
    from onebot_control.drive.wheels.finding import RunningGear
    from onebot_control.drive.wheels.rollers import OmniWheels
    from onebot_description.description import Description


@dataclass(frozen=True)
class OmniParameters(HolonomicParameters):
    """omni_wheel_drive_controller's parameters."""

    wheel_names: tuple[str, ...] = parameter(
        (),
        "joints of the wheels, anticlockwise; empty: found in the URDF",
        unique=True,
        read_only=True,
    )
    robot_radius: float = read_from_urdf("radius of the circle of wheels about the base's frame")
    wheel_radius: float = read_from_urdf("radius of the wheels")
    wheel_offset: float = parameter(
        0.0, "direction of the first wheel, rad to the left of forward; used with robot_radius"
    )
    pose_covariance_diagonal: Diagonal = variances(
        "; zeros: they grow on the way", name="diagonal_covariance.pose"
    )
    twist_covariance_diagonal: Diagonal = variances(name="diagonal_covariance.twist")

    @classmethod
    def is_found(cls, gear: "RunningGear") -> bool:
        return bool(gear.omni)

    def wheels(self, description: "Description") -> "OmniWheels":
        from onebot_control.drive.wheels.rollers import OmniWheels  # imports numpy

        return OmniWheels(description, self.wheel_names)

    def geometry(self, wheels: "OmniWheels") -> HolonomicKinematics:
        radius, count = self.wheel_radius or wheels.radius, len(wheels.names)
        if self.robot_radius:
            return HolonomicKinematics.omni(radius, self.robot_radius, count, self.wheel_offset)
        return HolonomicKinematics(radius, wheels.rows, "omni")
