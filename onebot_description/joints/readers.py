"""Typed reading of parameter values: what ROS hands over, checked, with the remedy in the error."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from onebot_description.joints.problems import Problem
from onebot_description.text import did_you_mean

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
