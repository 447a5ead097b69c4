"""joint_state_publisher's parameters: declared, read from files, and checked against each other."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rclpy.exceptions import InvalidTopicNameException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.validate_topic_name import validate_topic_name

from onebot_description.errors import OneBotError
from onebot_description.joints.config import DEFAULTS, JointsConfig
from onebot_description.joints.live_parameters import LiveParameters
from onebot_description.joints.parameter_files import read_files
from onebot_description.joints.problems import ConfigError, Problem
from onebot_description.ros_arguments import RosArguments
from onebot_description.ros_parameters import declare, parameter, plain

_OWN = {"robot_description": "", "config_file": ""}  # of the node, beside those of the joints


class JointParameters:
    """The parameters of a node.

    Attributes:
        live: the files they come from.
        values: those at the start, by name.
        config: the same, checked.
    """

    def __init__(self, node: Node, arguments: RosArguments) -> None:
        """Declare every parameter that anybody set, and the rest with its default.

        Raises:
            ConfigError: something is wrong with them.
        """
        self._node = node
        self._name = node.get_fully_qualified_name()
        self._places: Mapping[str, str] = {}  # of the file being taken up
        self.live = LiveParameters(arguments.files, self._name)
        given = [name for to, name in arguments.names if to in ("", node.get_name())]
        self.values = self._declare(given)
        self.live.pin(given, self.values)
        if self.live.remark:
            node.get_logger().warning(self.live.remark)
        try:
            self.config = self._checked(self.values)
        except ConfigError as error:
            raise error.located(self.live.places(self.values)) from None

    def _declare(self, given: Sequence[str]) -> dict[str, Any]:
        defaults = {**DEFAULTS, **_OWN}
        for name in dict.fromkeys([*defaults, *self.live.file.values, *given]):
            declare(self._node, name, defaults.get(name))
        values = self._current()
        config_file = values["config_file"]
        if isinstance(config_file, str) and config_file:
            self.live.add(config_file)
            written = self.live.file.values
            self._node.set_parameters([parameter(name, value) for name, value in written.items()])
            values = self._current()
        return values

    def _current(self) -> dict[str, Any]:
        parameters = self._node.get_parameters_by_prefix("")
        return {n: plain(p.value) for n, p in parameters.items() if p.value is not None}

    def changed(
        self, values: Mapping[str, Any], parameters: Sequence[Parameter]
    ) -> tuple[dict[str, Any], JointsConfig]:
        """Return all values and the configuration there would be with ``parameters`` set.

        Args:
            values: those in force.
            parameters: to be set together; one without a value is unset.

        Raises:
            ConfigError: they cannot be set, and why.
        """
        changed = dict(values)
        for one in parameters:
            changed[one.name] = plain(one.value)
            if one.value is None:
                del changed[one.name]
        config = self._checked(changed)
        config_file = changed.get("config_file")
        if config_file and config_file != values.get("config_file"):
            read_files([Path(config_file)], self._name)
        return changed, config

    def located(self, error: ConfigError) -> ConfigError:
        """Return an error about parameters being set, naming the lines they are written on."""
        return error.located(self._places)

    def set_all(self, changes: Mapping[str, Any], places: Mapping[str, str]) -> None:
        """Set all parameters or none.

        Args:
            changes: by name; None unsets.
            places: where they were written.

        Raises:
            OneBotError: they were refused.
        """
        if not changes:
            return
        self._places = places
        try:
            parameters = [parameter(name, value) for name, value in changes.items()]
            result = self._node.set_parameters_atomically(parameters)
        finally:
            self._places = {}
        if not result.successful:
            raise OneBotError(result.reason)

    def _checked(self, values: Mapping[str, Any]) -> JointsConfig:
        """Check everything, also what JointsConfig cannot: topic names, and the node's own."""
        config = JointsConfig.from_parameters(values)
        problems = [
            Problem(name, f"{values[name]} is no text; write a path in quotes")
            for name in _OWN
            if not isinstance(values.get(name, ""), str)
        ]
        problems += self._topic_problems(config.source_list)
        if problems:
            raise ConfigError(problems)
        return config

    def _topic_problems(self, topics: Sequence[str]) -> list[Problem]:
        problems = []
        own = self._node.resolve_topic_name("joint_states")
        for topic in topics:
            try:
                validate_topic_name(topic)
                same = self._node.resolve_topic_name(topic) == own
            except InvalidTopicNameException as error:
                problems.append(Problem("source_list", " ".join(str(error).split())))
                continue
            if same:
                text = f"{topic} is the topic this node publishes; name another one"
                problems.append(Problem("source_list", text))
        return problems
