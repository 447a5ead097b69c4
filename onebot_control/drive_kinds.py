"""The kinds of drives, by their types in ros2_control; a new kind is a row of the table."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar

from onebot_control.drive.diff_drive import DiffDriveParameters
from onebot_control.drive.mecanum import MecanumParameters
from onebot_control.drive.omni import OmniParameters
from onebot_control.drive.parameters import DriveParameters
from onebot_control.drive.steered import SteeringControllerParameters, TricycleParameters
from onebot_control.simulation_parameters import SimulationConfig
from onebot_description.parameters.reader import is_parameter, leaves, read

if TYPE_CHECKING:
    from onebot_description.description import Description

T = TypeVar("T")


@dataclass(frozen=True)
class ControlConfig(DiffDriveParameters, SimulationConfig):
    """All parameters of velocity_controller: the simulation's and diff_drive_controller's."""

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> "ControlConfig":
        """Check parameters, and convert them to a config.

        Args:
            values: values by their dotted ROS names, such as ``linear.x.max_velocity``.

        Raises:
            ConfigError: values are wrong; it names each of them, and what to write.
        """
        return read(cls, values)


@cache
def _all_parameters(drive: type[DriveParameters[Any]]) -> type[SimulationConfig]:
    """Return the dataclass of all parameters of a drive's node: its own and the simulation's."""
    values = {"__doc__": drive.__doc__, "__module__": __name__}
    kind: type[SimulationConfig] = type(drive.__name__, (drive, SimulationConfig), values)
    return dataclass(frozen=True)(kind)


DEFAULT_DRIVE = "diff_drive_controller/DiffDriveController"
_OTHER_DRIVES: Mapping[str, type[DriveParameters[Any]]] = {
    "mecanum_drive_controller/MecanumDriveController": MecanumParameters,
    "clearpath_mecanum_drive_controller/MecanumDriveController": MecanumParameters,
    "husarion_mecanum_drive_controller/MecanumDriveController": MecanumParameters,
    "omni_wheel_drive_controller/OmniWheelDriveController": OmniParameters,
    "ackermann_steering_controller/AckermannSteeringController": SteeringControllerParameters,
    "bicycle_steering_controller/BicycleSteeringController": SteeringControllerParameters,
    "tricycle_steering_controller/TricycleSteeringController": SteeringControllerParameters,
    "tricycle_controller/TricycleController": TricycleParameters,
}
DRIVES: Mapping[str, type[SimulationConfig]] = {
    DEFAULT_DRIVE: ControlConfig,
    **{kind: _all_parameters(drive) for kind, drive in _OTHER_DRIVES.items()},
}
"""The parameters of each drive's node, by the drive's type."""


def found_drive(description: "Description") -> type[SimulationConfig]:
    """Return the parameters of a robot's drive, from its description; the default in doubt.

    Raises:
        OneBotError: the mesh of a collision shape cannot be read.
    """
    from onebot_control.drive.wheels.finding import RunningGear  # imports numpy

    gear = RunningGear.of(description)
    drives = [drive for drive in DRIVES.values() if issubclass(drive, DriveParameters)]
    return next((drive for drive in drives if drive.is_found(gear)), ControlConfig)


def topics_of(declared: type[SimulationConfig]) -> tuple[str, str]:
    """Return the names of the command topic and the odometry topic of a drive's controller."""
    assert issubclass(declared, DriveParameters)
    return declared.topics


def named_drive(values: Mapping[str, Any]) -> type[SimulationConfig] | None:
    """Return the parameters of the first drive with joint names in ``values``; None if none.

    The read-only ones among a drive's own parameters are those that name joints.
    """
    simulated = {leaf.name for leaf in leaves(SimulationConfig)}
    named = {name for name, value in values.items() if value} - simulated
    for drive in DRIVES.values():
        if any(leaf.name in named and leaf.type.rule.read_only for leaf in leaves(drive)):
            return drive
    return None


def suited(values: Mapping[str, T], declared: type[SimulationConfig]) -> dict[str, T]:
    """Return the values from OneBot's file that another drive has, too.

    Limits of driving sideways are copied from those of driving forward.
    """
    sideways = {
        name.replace("linear.x.", "linear.y."): value
        for name, value in values.items()
        if name.startswith("linear.x.")
    }
    all_values = {**sideways, **values}
    return {name: value for name, value in all_values.items() if is_parameter(declared, name)}
