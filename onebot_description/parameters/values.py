"""What one value may be: its type and rules, and the errors of a value that breaks them."""

import math
import re
from array import array
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from onebot_description.errors import did_you_mean, shortened

MAX_PORT = 65535
"""The greatest number of a TCP port."""

LARGEST = 1e60
"""The greatest size of a number: products of a few of them are finite."""

_INT64 = range(-(2**63), 2**63)

_SINGULAR = {float: "a number", int: "an integer", bool: "true or false", str: "a string"}
_PLURAL = {float: "numbers", int: "integers", bool: "booleans", str: "strings"}


@dataclass(frozen=True)
class Rule:
    """What one value means and may be. Rules on numbers and strings are for each one in a list."""

    description: str = ""  # one line, with the unit
    name: str = ""  # in ROS or YAML, if it is not the field's; may hold dots
    above: float | None = None  # numbers must be greater
    at_least: float | None = None
    at_most: float | None = None
    choices: tuple[str, ...] = ()  # the only strings allowed
    not_empty: bool = False  # neither a string nor a list may be empty
    unique: bool = False  # a list must not hold anything twice
    pattern: re.Pattern[str] | None = None  # what a string must match
    write: str = ""  # what would be right, for errors, such as "a topic, such as /odom"
    nan: str = ""  # what NaN means, such as "no limit"; empty if the number must be finite
    read_only: bool = False  # it is read once, when the node starts

    @property
    def range(self) -> str:
        """The range in words, such as "above 0 and up to 1000"; empty for none."""
        if self.above is not None:
            most = "" if self.at_most is None else f" and up to {self.at_most:g}"
            return f"above {self.above:g}{most}"
        if self.at_least is not None:
            most = "" if self.at_most is None else f" to {self.at_most:g}"
            return f"from {self.at_least:g}{most}"
        return "" if self.at_most is None else f"up to {self.at_most:g}"

    def beyond(self, value: float) -> str:
        """Return on which side ``value`` is out of range; empty if it is within."""
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
    length: int | None = None  # of the list; None for any
    optional: bool = False  # None and an empty list are "not given"

    def checked(self, value: Any) -> Any:
        """Return ``value`` checked.

        Raises:
            ValueError: what is wrong and what would be right.
        """
        if self.optional and (value is None or _is_list(value) and not len(value)):
            return None
        if value is None:
            raise ValueError(f"has no value; write {self.wanted(value)}")
        return self._list(value) if self.many else self._one(value)

    def _list(self, value: Any) -> tuple[Any, ...]:
        if not _is_list(value):
            raise ValueError(f"{shown(value)}; write {self.wanted(value)}")
        items = tuple(self._one(item) for item in value)
        if self.length is not None and len(items) != self.length:
            what = self.rule.write
            if not what:
                what = ": ".join(filter(None, (str(self.length), self.rule.description)))
            raise ValueError(f"{len(items)} {_PLURAL[self.base]}; write {what}")
        if self.rule.not_empty and not items:
            raise ValueError(f"is empty; write {self.wanted(value)}")
        twice = [item for item in dict.fromkeys(items) if items.count(item) > 1]
        if self.rule.unique and twice:
            raise ValueError(f'"{twice[0]}" is there twice')
        return items

    def _one(self, value: Any) -> Any:
        if self.base is float:
            return self._number(value)
        if type(value) is not self.base:
            raise ValueError(f"{shown(value)}; write {self.wanted(value)}")
        if isinstance(value, str):
            self._check_text(value)
        elif self.base is int:
            if value not in _INT64:
                raise ValueError(f"needs more than 64 bits; write {self.wanted(value)}")
            self._check_range(value)
        return value

    def _number(self, value: Any) -> float:
        if not _is_number(value):
            raise ValueError(f"{shown(value)}; write {self.wanted(value)}")
        try:
            number = float(value)
        except OverflowError:  # an integer of more than 308 digits
            number = math.inf
        if math.isnan(number) and self.rule.nan:
            return math.nan
        if not math.isfinite(number):
            raise ValueError(f"{number} is not finite; write {self.wanted(value)}")
        if abs(number) > LARGEST:
            raise ValueError(f"{number:g} is beyond {LARGEST:g}; write {self.wanted(value)}")
        self._check_range(number)
        return number

    def _check_range(self, value: Any) -> None:
        if beyond := self.rule.beyond(value):
            unset = f", or .nan for {self.rule.nan}" if self.rule.nan else ""
            raise ValueError(f"{value:g} {beyond}; write a number {self.rule.range}{unset}")

    def _check_text(self, value: str) -> None:
        rule = self.rule
        if rule.choices and value not in rule.choices:
            raise ValueError(f'no "{shortened(value)}"{did_you_mean(value, rule.choices)}')
        if rule.not_empty and not value:
            raise ValueError(f"is empty; write {self.wanted(value)}")
        if rule.pattern and not rule.pattern.fullmatch(value):
            raise ValueError(f'"{shortened(value)}" is not possible; write {self.wanted(value)}')

    def wanted(self, value: Any = None) -> str:
        """What would be right, such as "a number from 0 to 1", in place of ``value``."""
        if self.rule.write:
            return self.rule.write
        if self.many:
            length = "" if self.length is None else f"{self.length} "
            return f"a list of {length}{_PLURAL[self.base]}, such as {self._example()}"
        if self.rule.choices:
            return f"one of {', '.join(self.rule.choices)}"
        if self.base is str and _is_number(value):
            return f'a string, such as "{value}"'
        within = f" {self.rule.range}" if self.rule.range else ""
        return f"{_SINGULAR[self.base]}{within}"

    def _example(self) -> str:
        words = {str: ["first", "second", "third"], bool: ["true", "false"]}.get(
            self.base, ["0.0", "1.0", "2.0"] if self.base is float else ["0", "1", "2"]
        )
        length = 2 if self.length is None else self.length
        return f"[{', '.join(words[i % len(words)] for i in range(length))}]"

    @property
    def constraints(self) -> str:
        """The rules in words, for a parameter's descriptor."""
        rule = self.rule
        words = [rule.range, f"one of {', '.join(rule.choices)}" if rule.choices else ""]
        words.append(f"{self.length} {_PLURAL[self.base]}" if self.length is not None else "")
        words.append("not empty" if rule.not_empty else "")
        words.append("no duplicates" if rule.unique else "")
        words.append(rule.write)
        words.append(f"NaN: {rule.nan}" if rule.nan else "")
        words.append("read when the node starts; restart it to change it" * rule.read_only)
        return "; ".join(word for word in words if word)


def plain(value: Any) -> Any:
    """Return a parameter's value, arrays as lists: they come as array.array, tuple or list."""
    return list(value) if isinstance(value, array | tuple | list) else value


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_list(value: object) -> bool:
    return isinstance(value, array | tuple | list)


def shown(value: object) -> str:
    """Name the value and its kind, for an error about its type."""
    if value is None:
        return "has no value"
    if isinstance(value, bool):
        return f"{str(value).lower()} is a bool"
    if isinstance(value, str):
        return f'"{shortened(value)}" is a string'
    if isinstance(value, int) and value not in _INT64:
        return "an integer of more than 64 bits is a number"
    if _is_number(value):
        return f"{value} is a number"
    if _is_list(value):
        return f"{_list_text(plain(value))} is a list"
    return "is a map" if isinstance(value, Mapping) else f"{value!r} cannot be used here"


def _list_text(values: list[Any]) -> str:
    try:
        return shortened(str(values))
    except ValueError:  # of an integer of too many digits
        return "[...]"
