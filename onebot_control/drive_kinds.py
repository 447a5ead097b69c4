"""The kinds of drives, by their types in ros2_control."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from onebot_control.drive.diff_drive import DiffDriveParameters
from onebot_control.simulation_parameters import SimulationConfig
from onebot_description.parameters.reader import read


@dataclass(frozen=True)
class ControlConfig(DiffDriveParameters, SimulationConfig):
    """All parameters of velocity_controller: the simulation's and diff_drive_controller's."""

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> "ControlConfig":
        """Check parameters, and convert them to a config.

        Args:
            values: values by their dotted ROS names, such as ``linear.x.max_velocity``.

        Raises:
            ConfigError: values are wrong; it names each of them, and what would be right.
        """
        return read(cls, values)

    @property
    def standing(self) -> SimulationConfig:
        """The same without the drive's parameters, for a robot that stands."""
        names = [field.name for field in fields(SimulationConfig)]
        return SimulationConfig(**{name: getattr(self, name) for name in names})


DRIVES: Mapping[str, type[SimulationConfig]] = {
    "diff_drive_controller/DiffDriveController": ControlConfig
}
"""The parameters of each drive's node, by the drive's type."""
