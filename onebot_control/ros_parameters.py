"""velocity_controller's parameters: declared, checked against each other and against the robot."""

from collections.abc import Mapping, Sequence
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter

from onebot_control.control_config import ControlConfig, unknown_parameters
from onebot_control.control_files import read_control_files
from onebot_control.control_parameters import DEFAULTS, READ_AT_START
from onebot_description.joints.problems import ConfigError, Problem
from onebot_description.ros_arguments import RosArguments
from onebot_description.ros_parameters import declare, plain


class ControlParameters:
    """The parameters of a node.

    Attributes:
        values: in force, by name.
        config: the same, checked.
    """

    def __init__(self, node: Node, arguments: RosArguments) -> None:
        """Declare them, with what the files and the command line say.

        Raises:
            ConfigError: something is wrong with them.
        """
        self._node = node
        namespace, name = node.get_namespace(), node.get_name()
        file = read_control_files(arguments.files, namespace, name)
        given = [n for to, n in arguments.names if to in ("", name)]
        if problems := unknown_parameters(dict.fromkeys(given)):
            raise ConfigError(problems)
        for key, default in {**DEFAULTS, **file.values}.items():
            declare(node, key, default)
        self.values = {key: plain(node.get_parameter(key).value) for key in DEFAULTS}
        places = {k: at for k, at in file.places.items() if self.values.get(k) == file.values[k]}
        try:
            self.config = ControlConfig.from_parameters(self.values)
        except ConfigError as error:
            raise error.located(places) from None
        self._places = places

    def located(self, error: ConfigError) -> ConfigError:
        """Return an error about these parameters, naming the lines they were written on."""
        return error.located(self._places)

    def changed(self, parameters: Sequence[Parameter], simulated: bool) -> ControlConfig:
        """Return the configuration there would be with these parameters set.

        Args:
            parameters: to be set together.
            simulated: whether the node's time is simulated.

        Raises:
            ConfigError: they cannot be set, and why.
        """
        changes = {p.name: plain(p.value) for p in parameters if p.name in DEFAULTS}
        problems = [
            Problem(name, "is read when the node starts; restart it to change it")
            for name, value in changes.items()
            if name in READ_AT_START and value != self.values[name]
        ]
        problems += [
            Problem(name, "cannot be unset") for name, value in changes.items() if value is None
        ]
        problems += self._clock_problems(parameters, simulated)
        if problems:
            raise ConfigError(problems)
        return ControlConfig.from_parameters({**self.values, **changes})

    def accept(self, parameters: Sequence[Parameter]) -> None:
        """Take up parameters that ``changed`` found nothing wrong with."""
        changes = {p.name: plain(p.value) for p in parameters if p.name in DEFAULTS}
        self.values.update(changes)
        self.config = ControlConfig.from_parameters(self.values)

    def _clock_problems(self, parameters: Sequence[Parameter], simulated: bool) -> list[Problem]:
        values: Mapping[str, Any] = {p.name: p.value for p in parameters}
        problems = []
        if values.get("use_sim_time", simulated) not in (simulated, None):
            text = "is read when the node starts; restart it to change whose time it uses"
            problems.append(Problem("use_sim_time", text))
        if not simulated and values.get("real_time_factor", 1.0) not in (1, 1.0):
            text = "this node keeps the system's time; start it with use_sim_time:=true"
            problems.append(Problem("real_time_factor", f"{text} to change the pace while it runs"))
        return problems
