"""Checks the type and rules of one value, with errors that say what to write."""

import math
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import cycle, islice
from typing import Any

from onebot_description.errors import did_you_mean, shortened

MAX_PORT = 65535
"""The maximum number of a TCP port."""

LARGEST = 1e60
"""The maximum absolute value of a parameter, so that products of a few are finite."""

INT64 = range(-(2**63), 2**63)
"""The range of integer parameters."""

NAMESPACE = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
"""A namespace without slashes, such as that of one robot among several."""

NAMESPACE_WANTED = "letters, digits and _, not beginning with a digit"
"""What to write for a namespace."""

_SINGULAR = {float: "a number", int: "an integer", bool: "true or false", str: "a string"}
_PLURAL = {float: "numbers", int: "integers", bool: "booleans", str: "strings"}
_NAMES = {float: "double", int: "int", bool: "bool", str: "string"}
_EXAMPLES = {
    float: ("0.0", "1.0", "2.0"),
    int: ("0", "1", "2"),
    bool: ("true", "false"),
    str: ("first", "second", "third"),
}


@dataclass(frozen=True)
class Rule:
    """Description and rules of one value; in a list, rules apply to each element."""

    description: str = ""  # one line, with the unit
    name: str = ""  # its name in ROS or YAML, if it differs from the field's; may contain dots
    above: float | None = None  # numbers must be larger
    at_least: float | None = None
    at_most: float | None = None
    choices: tuple[str, ...] = ()  # the only strings allowed
    not_empty: bool = False  # neither a string nor a list may be empty
    unique: bool = False  # a list must not contain duplicates
    pattern: re.Pattern[str] | None = None  # a string must match it
    write: str = ""  # what to write, for errors, such as "a topic, such as /odom"
    nan: str = ""  # what NaN means, such as "no limit"; empty if the number must be finite
    infinite: bool = False  # whether a number may be infinite
    read_only: bool = False  # it is read once, when the node starts
    keys: tuple[str, ...] = ()  # the meaning of a map's names, such as "joint"

    def __repr__(self) -> str:
        """Return the valid values, as ``help()`` shows them in signatures."""
        return self.write or self.range or ", ".join(self.choices) or "any"

    @property
    def range(self) -> str:
        """The range in words, such as "above 0 and up to 1000"; empty for none."""
        end = "" if self.at_most is None else f"to {self.at_most:g}"
        if self.at_least is not None:
            return _join(" ", f"from {self.at_least:g}", end)
        above = "" if self.above is None else f"above {self.above:g}"
        return _join(" and ", above, f"up {end}" if end else "")

    def beyond(self, value: float) -> str:
        """Return how ``value`` is out of range; empty if it is within."""
        if self.above is not None and not value > self.above:
            return f"is not above {self.above:g}"
        if self.at_least is not None and value < self.at_least:
            return f"is below {self.at_least:g}"
        if self.at_most is not None and value > self.at_most:
            return f"is above {self.at_most:g}"
        return ""


@dataclass(frozen=True)
class ValueType:
    """The type of a value, and its rules."""

    base: type  # float, int, bool or str
    rule: Rule = Rule()
    many: bool = False  # it is a list
    length: int | None = None  # length of the list; None for any
    optional: bool = False  # None and an empty list mean "not given"

    def checked(self, value: Any) -> Any:
        """Return ``value`` checked; a ValueError says what is wrong and what to write."""
        value = plain(value)
        if self.optional and value in (None, []):
            return None
        if value is None:
            raise ValueError(f"has no value; write {self.wanted(value)}")
        return self._list(value) if self.many else self._one(value)

    def _list(self, value: Any) -> tuple[Any, ...]:
        if not isinstance(value, list):
            raise ValueError(f"{shown(value)}; write {self.wanted(value)}")
        items = tuple(self._one(item) for item in value)
        if self.length is not None and len(items) != self.length:
            what = self.rule.write or _join(": ", str(self.length), self.rule.description)
            raise ValueError(f"{len(items)} {_PLURAL[self.base]}; write {what}")
        if self.rule.not_empty and not items:
            raise ValueError(f"is empty; write {self.wanted(value)}")
        if self.rule.unique and len(set(items)) < len(items):
            twice = next(item for item, count in Counter(items).items() if count > 1)
            raise ValueError(f'"{twice}" occurs twice')
        return items

    def _one(self, value: Any) -> Any:
        value = plain(value)
        fits = isinstance(value, int | float if self.base is float else self.base)
        if not fits or (isinstance(value, bool) and self.base is not bool):
            raise ValueError(f"{shown(value)}; write {self.wanted(value)}")
        maximum = max(INT64[-1], int(self.rule.at_most or 0))
        if isinstance(value, int) and not INT64[0] <= value <= maximum:
            raise ValueError(f"needs more than 64 bits; write {self.wanted(value)}")
        if isinstance(value, str):
            self._check_text(value)
        elif self.base is not bool:
            value = self.base(value)
            self._check_number(value)
        return value

    def _check_number(self, value: Any) -> None:
        if (self.rule.nan and math.isnan(value)) or (self.rule.infinite and math.isinf(value)):
            return
        if self.base is float and not abs(value) <= LARGEST:
            beyond = f"beyond {LARGEST:g}" if math.isfinite(value) else "not finite"
            raise ValueError(f"{value:g} is {beyond}; write {self.wanted(value)}")
        if beyond := self.rule.beyond(value):
            remedy = self.rule.write or f"a number {self.rule.range}{self._unset}"
            raise ValueError(f"{value:g} {beyond}; write {remedy}")

    def _check_text(self, value: str) -> None:
        rule = self.rule
        if rule.choices and value not in rule.choices:
            raise ValueError(f'no "{shortened(value)}"{did_you_mean(value, rule.choices)}')
        if rule.not_empty and not value:
            raise ValueError(f"is empty; write {self.wanted(value)}")
        if rule.pattern and not rule.pattern.fullmatch(value):
            raise ValueError(f'"{shortened(value)}" is not valid; write {self.wanted(value)}')

    def wanted(self, value: Any = None) -> str:
        """Return what to write in place of ``value``, such as "a number from 0 to 1"."""
        if self.rule.write:
            return self.rule.write
        if self.many:
            what = _join(" ", str(self.length or ""), _PLURAL[self.base])
            example = islice(cycle(_EXAMPLES[self.base]), self.length or 2)
            return f"a list of {what}, such as [{', '.join(example)}]"
        if self.rule.choices:
            return f"one of {', '.join(self.rule.choices)}"
        if self.base is str and type(value) in (int, float):
            return f'a string, such as "{value}"'
        return _join(" ", _SINGULAR[self.base], self.rule.range) + self._unset

    @property
    def _unset(self) -> str:
        return f", or .nan for {self.rule.nan}" if self.rule.nan else ""

    @property
    def name(self) -> str:
        """Its name in ROS, such as double[]."""
        return _NAMES[self.base] + "[]" * self.many

    @property
    def meaning(self) -> str:
        """The meaning and valid values of the parameter, in one line."""
        rule = self.rule
        limits = rule.range if rule.at_most is not None else ""
        choices = f"one of {', '.join(rule.choices)}" if rule.choices else ""
        return _join("; ", rule.description, limits, choices, f".nan: {rule.nan}" * bool(rule.nan))


def _join(separator: str, *words: str) -> str:
    return separator.join(word for word in words if word)


def plain(value: Any) -> Any:
    """Return a value as plain Python: arrays and tuples as lists, numpy scalars as numbers."""
    if hasattr(value, "tolist"):  # array.array and numpy have it; numpy is slow to import
        return value.tolist()
    return list(value) if isinstance(value, tuple) else value


def yaml_text(value: Any) -> str:
    """Return a value as YAML on one line; an empty string for None."""
    if value is None:
        return ""
    if isinstance(value, list):
        return f"[{', '.join(map(yaml_text, value))}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float) and math.isnan(value):
        return ".nan"
    return str(value) if value != "" else '""'


def shown(value: object) -> str:
    """Name the value and its kind, for an error about its type."""
    value = plain(value)
    if value is None:
        return "has no value"
    if isinstance(value, bool):
        return f"{str(value).lower()} is a bool"
    if isinstance(value, str):
        return f'"{shortened(value)}" is a string'
    if isinstance(value, int | float):
        return f"{value} is a number"
    if isinstance(value, list):
        return f"{shortened(str(value))} is a list"
    return (
        "is a map"
        if isinstance(value, Mapping)
        else f"{shortened(repr(value))} cannot be used here"
    )
