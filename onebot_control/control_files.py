"""Reading control.yaml, which is in ros2_control's form: three nodes' parameters in one file."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from onebot_control.control_config import unknown_parameters
from onebot_control.control_parameters import (
    BROADCASTER,
    BROADCASTER_DEFAULTS,
    BROADCASTER_TYPE,
    CONTROLLER_TYPE,
    ROS_PARAMETERS,
    ROS_PREFIXES,
)
from onebot_description.ament import package_share
from onebot_description.joints.parameter_yaml import Parameters, read_parameters
from onebot_description.joints.problems import ConfigError, Problem
from onebot_description.text import did_you_mean

# What is said to a node nobody has heard of is said to all, and may be meant for others.
_NOBODY = "node_that_no_file_names"

Unknown = Callable[[Mapping[str, Any]], list[Problem]]


def default_control_file() -> Path:
    """Return OneBot's own control.yaml."""
    return package_share("onebot_control") / "config" / "control.yaml"


def read_control_files(files: Sequence[Path], namespace: str, controller: str) -> Parameters:
    """Read what ``files`` say to controller_manager, joint_state_broadcaster and the controller.

    Args:
        files: later ones come first.
        namespace: of the nodes, such as "/".
        controller: name of the controller's node.

    Returns:
        The controller's parameters; the broadcaster's begin with ``joint_state_broadcaster.``.

    Raises:
        ConfigError: with all that is wrong in the file, each with its line.
    """
    found = Parameters()
    for file in files:
        found.update(_File(file, namespace).read(controller))
    return found


class _File:
    def __init__(self, file: Path, namespace: str) -> None:
        self._file = file
        self._namespace = namespace.rstrip("/")
        try:
            self._text = file.read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
            raise ConfigError([Problem("", f"{file}: cannot be read: {reason}")]) from None

    def read(self, controller: str) -> Parameters:
        types = {f"{controller}.type": CONTROLLER_TYPE, f"{BROADCASTER}.type": BROADCASTER_TYPE}
        found, problems = self._section(controller, unknown_parameters)
        manager, more = self._section("controller_manager", _unknown_but("update_rate", *types))
        problems += more
        broadcaster, more = self._section(BROADCASTER, _unknown_but(*BROADCASTER_DEFAULTS))
        problems += more + _wrong_types(manager.values, types)
        if problems:
            places = {**broadcaster.places, **manager.places, **found.places}
            raise ConfigError(problems, places)
        _take(found, manager, "update_rate", "update_rate")
        for name in BROADCASTER_DEFAULTS:
            _take(found, broadcaster, name, f"{BROADCASTER}.{name}")
        return found

    def _section(self, node: str, unknown: Unknown) -> tuple[Parameters, list[Problem]]:
        """Return what is said to a node, and what of it the node does not know.

        What is said to all nodes and unknown to this one is meant for another.
        """
        found = read_parameters(self._text, str(self._file), f"{self._namespace}/{node}")
        to_all = read_parameters(self._text, str(self._file), f"{self._namespace}/{_NOBODY}")
        for problem in unknown(to_all.values):
            name = problem.key
            if found.places.get(name) == to_all.places[name]:
                del found.values[name], found.places[name]
        return found, unknown(found.values)


def _unknown_but(*known: str) -> Unknown:
    """Return what finds the names that are neither known nor every node's."""

    def unknown(values: Mapping[str, Any]) -> list[Problem]:
        return [
            Problem(name, f"unknown parameter{did_you_mean(name, known)}")
            for name in values
            if name not in {*known, *ROS_PARAMETERS} and not name.startswith(ROS_PREFIXES)
        ]

    return unknown


def _wrong_types(values: Mapping[str, Any], types: Mapping[str, str]) -> list[Problem]:
    return [
        Problem(name, f"{values[name]} is not what runs here; write {kind}")
        for name, kind in types.items()
        if values.get(name, kind) != kind
    ]


def _take(found: Parameters, other: Parameters, name: str, known_as: str) -> None:
    """Take a parameter of another node, unless the controller's own section gives it."""
    if name in other.values and known_as not in found.values:
        found.values[known_as] = other.values[name]
        found.places[known_as] = other.places[name]
