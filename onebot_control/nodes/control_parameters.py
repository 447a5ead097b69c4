"""The parameters of a robot's node, declared and kept up to date."""

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter

from onebot_control.control_files import ControlFiles, drive_node
from onebot_control.drive.parameters import DriveParameters
from onebot_control.drive_kinds import ControlConfig
from onebot_control.simulation_parameters import SimulationConfig
from onebot_description.parameters.reader import (
    ConfigError,
    Problem,
    is_parameter,
    read,
    unknown_parameters,
)
from onebot_description.parameters.values import plain
from onebot_description.ros.command_line import RosArguments
from onebot_description.ros.node_parameters import declare

# Limits that have no effect without another one.
_IDLE = {
    "min_velocity": "max_velocity",
    "max_deceleration": "max_acceleration",
    "min_jerk": "max_jerk",
}


class ControlParameters:
    """The parameters of a controller's node: declared on it, checked, and kept up to date.

    Attributes:
        declared: dataclass of the parameters, with those of a drive unless the base is fixed.
        values: the current values, by name.
        config: the same values, checked.
        places: file and line of each value from a file.
        topics: the node's topics of commands and odometry.
        joints: the joint controllers.
        foreign_sections: warnings about sections for none of the robot's nodes, by file and
            section.
    """

    def __init__(
        self,
        node: Node,
        arguments: RosArguments,
        declared: type[SimulationConfig],
        given: Mapping[str, Any] = MappingProxyType({}),
    ) -> None:
        """Declare the parameters, with the values of files and command line.

        Args:
            node: node to declare them on.
            arguments: the node's ROS arguments.
            declared: dataclass of the parameters; those of a drive are replaced if a file names
                another type.
            given: values that override files and command line.

        Raises:
            ConfigError: values are wrong; it names each of them.
        """
        namespace, name = node.get_namespace(), node.get_name()
        drives = issubclass(declared, DriveParameters)
        config_type = declared if drives else ControlConfig
        files = ControlFiles(arguments.files, namespace, name, config_type)
        file = files.parameters()
        self.declared = declared = files.declared if drives else declared
        _, *self.topics = drive_node(arguments.files)
        self.joints, self.foreign_sections = files.joint_controllers(), files.foreign_sections()
        self._ignored = [*dict.fromkeys([*file.warnings, *self.joints.warnings])]
        names = arguments.names_for(name)
        if problems := unknown_parameters(self.declared, names):
            raise ConfigError(problems)
        # Values of files are used unless -p sets them. If files have several sections for a node,
        # rcl would use the last one of the first file, regardless of later files.
        written = {name: v for name, v in file.values.items() if name not in names}
        overrides = {name: v for name, v in given.items() if is_parameter(self.declared, name)}
        self.values = declare(node, self.declared, file.values, fixed={**written, **overrides})
        self.places = {
            k: at for k, at in file.places.items() if self.values.get(k) == file.values[k]
        }
        self.config = read(declared, self.values, self.places)

    @property
    def warnings(self) -> list[str]:
        """Warnings about entries without effect and about older names, each with its place."""
        limits = self.config.drive.limits if self.config.drive else {}
        problems = [
            Problem(f"{axis}.{name}", f"limits nothing without {axis}.{needed}")
            for axis, limit in limits.items()
            for name, needed in _IDLE.items()
            if math.isnan(getattr(limit, needed)) and not math.isnan(getattr(limit, name))
        ]
        problems += [
            Problem(f"{axis}.min_acceleration", f"an older name of {axis}.max_deceleration")
            for axis, limit in limits.items()
            if not math.isnan(limit.min_acceleration)
        ]
        return [*self._ignored, *(problem.message(self.places) for problem in problems)]

    def changed(self, parameters: Sequence[Parameter], simulated: bool) -> SimulationConfig:
        """Return the configuration with these parameters set, without applying it.

        Args:
            parameters: parameters to set.
            simulated: whether the node uses simulated time.

        Raises:
            ConfigError: values are wrong; it names each of them.
        """
        if problems := _clock_problems(parameters, simulated):
            raise ConfigError(problems)
        return read(self.declared, {**self.values, **self._own(parameters)})

    def accept(self, parameters: Sequence[Parameter]) -> None:
        """Apply parameters that ``changed`` has accepted."""
        self.values.update(self._own(parameters))
        self.config = read(self.declared, self.values)

    def _own(self, parameters: Sequence[Parameter]) -> dict[str, Any]:
        """Return the values of those ``parameters`` that are declared here, by name."""
        return {p.name: plain(p.value) for p in parameters if is_parameter(self.declared, p.name)}


def _clock_problems(parameters: Sequence[Parameter], simulated: bool) -> list[Problem]:
    values: Mapping[str, Any] = {p.name: p.value for p in parameters}
    problems = []
    if values.get("use_sim_time", simulated) not in (simulated, None):
        text = "is only read when the node starts; restart the node to change its time source"
        problems.append(Problem("use_sim_time", text))
    if not simulated and values.get("real_time_factor", 1.0) not in (1, 1.0):
        text = "this node uses the system time; start it with use_sim_time:=true"
        problems.append(Problem("real_time_factor", f"{text} to change the pace while it runs"))
    return problems
