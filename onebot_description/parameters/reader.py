"""Typed reading of parameter values: what ROS hands over, checked, with the remedy in the error."""

import math
from array import array
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from onebot_description.errors import OneBotError, did_you_mean

# Mistakes and remarks about joint parameters, each tied to the parameter it is about.


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong or surprising.

    Attributes:
        key: dotted name of the parameter (or of the group), such as ``motions.elbow.frequency``;
            empty when no parameter is to blame.
        text: what is wrong and what would be right.
    """

    key: str
    text: str

    def message(self, places: Mapping[str, str] | None = None) -> str:
        """Return ``place: key: text``.

        Args:
            places: where each parameter was written, such as ``joints.yaml:7``.
        """
        parts = (self._place(places or {}), self.key, self.text)
        return ": ".join(part for part in parts if part)

    def _place(self, places: Mapping[str, str]) -> str:
        """The place of the parameter itself, else of the first one inside the group it names."""
        if self.key in places:
            return places[self.key]
        if not self.key:
            return ""
        inside = self.key + "."
        return next((place for key, place in places.items() if key.startswith(inside)), "")


class ConfigError(OneBotError):
    """Joint parameters that cannot be used.

    Attributes:
        problems: every problem found.
    """

    def __init__(
        self, problems: Iterable[Problem], places: Mapping[str, str] | None = None
    ) -> None:
        """Join ``problems`` into one message, a line each; ``places`` as in Problem.message."""
        self.problems = tuple(problems)
        super().__init__("\n".join(problem.message(places) for problem in self.problems))

    def located(self, places: Mapping[str, str]) -> "ConfigError":
        """Return the same error, its message naming where each parameter was written."""
        return ConfigError(self.problems, places)


# Parameters of a node whose types are left open, so that 10 and 10.0 are both right.


def declare(node: Node, name: str, default: Any = None) -> None:
    """Declare a parameter, unless that was done; ``default`` counts where nobody has set it."""
    if node.has_parameter(name):
        return
    # Of an empty list rclpy cannot tell what kind it is: such is set afterwards.
    first = None if default == [] else default
    node.declare_parameter(name, first, ParameterDescriptor(dynamic_typing=True))
    if default == [] and node.get_parameter(name).value is None:
        node.set_parameters([parameter(name, default)])


def parameter(name: str, value: Any) -> Parameter:
    """Return a parameter of whichever type ``value`` has; None unsets it."""
    if value == []:
        return Parameter(name, Parameter.Type.STRING_ARRAY, [])
    return Parameter(name, value=value)


def plain(value: Any) -> Any:
    """Return a parameter's value, arrays as lists: they come as array.array, tuple or list."""
    return list(value) if isinstance(value, array | tuple | list) else value


Values = Mapping[str, Any]


class Reader:
    """Takes typed values out of a flat map of parameters and collects what is wrong with them.

    Attributes:
        problems: filled as values are read; nothing is raised.
    """

    def __init__(self, values: Values) -> None:
        """Read from ``values``: dotted name to value."""
        self.values = values
        self.problems: list[Problem] = []

    def complain(self, key: str, text: str) -> None:
        """Note a problem with the parameter ``key``."""
        self.problems.append(Problem(key, text))

    def number(self, key: str, default: float) -> float:
        """A finite number; 10 and 10.0 alike."""
        value = self.values.get(key, default)
        if not _is_number(value):
            self.complain(key, f"{_shown(value)}; write a number, such as {default:.1f}")
            return default
        if not math.isfinite(value):
            self.complain(key, f"{value} is not finite; write an ordinary number")
            return default
        return float(value)

    def flag(self, key: str, default: bool) -> bool:
        """True or false."""
        value = self.values.get(key, default)
        if not isinstance(value, bool):
            self.complain(key, f"{_shown(value)}; write true or false")
            return default
        return value

    def text(self, key: str, default: str = "") -> str:
        """A string."""
        value = self.values.get(key, default)
        if not isinstance(value, str):
            self.complain(key, f'{_shown(value)}; write a text, such as "{value}"')
            return default
        return value

    def choice(self, key: str, choices: Sequence[str], default: str) -> str:
        """One of several words."""
        value = self.text(key, default)
        if value not in choices:
            self.complain(key, f'no "{value}"{did_you_mean(value, choices)}')
            return default
        return value

    def numbers(self, key: str) -> tuple[float, ...]:
        """A list of finite numbers; empty when absent or wrong."""
        value = self.values.get(key, ())
        if not _is_list(value) or not all(_is_number(item) for item in value):
            self.complain(key, f"{_shown(value)}; write a list of numbers, such as [0.0, 1.0]")
            return ()
        if not all(math.isfinite(item) for item in value):
            self.complain(key, f"{list(value)} holds a number that is not finite")
            return ()
        return tuple(float(item) for item in value)

    def texts(self, key: str) -> tuple[str, ...]:
        """A list of strings; empty when absent or wrong."""
        value = self.values.get(key, ())
        if not _is_list(value) or not all(isinstance(item, str) for item in value):
            self.complain(key, f"{_shown(value)}; write a list of texts, such as [first, second]")
            return ()
        return tuple(value)


def flatten(values: Values, prefix: str = "") -> dict[str, Any]:
    """Return nested maps as one map of dotted names; a value of None counts as not given."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Mapping):
            flat.update(flatten(value, f"{prefix}{key}."))
        elif value is not None:
            flat[f"{prefix}{key}"] = value
    return flat


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_list(value: object) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


def _shown(value: object) -> str:
    """Name the value and its kind, for an error about its type."""
    if isinstance(value, bool):
        return f"{str(value).lower()} is a bool"
    if isinstance(value, str):
        return f'"{value}" is a text'
    if _is_number(value):
        return f"{value} is a number"
    return f"{value} is a list" if _is_list(value) else f"{value!r} is of no use here"
