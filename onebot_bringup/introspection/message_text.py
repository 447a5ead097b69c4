"""Reads messages from YAML, as in ``ros2 topic pub``; rosidl_runtime_py writes them.

Reading is strict: a value that does not fit its field is an error that names the field, and nothing
is rounded or truncated.
"""

import array
import math
import re
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
import yaml
from rosidl_parser.definition import (
    AbstractGenericString,
    AbstractNestedType,
    Array,
    BoundedSequence,
    NamespacedType,
)

from onebot_description.errors import OneBotError, did_you_mean
from onebot_description.parameters import bounded_yaml
from onebot_description.ros.packages.rosidl_runtime_py.convert import slot_name
from onebot_description.ros.wire.definition import type_name
from onebot_description.ros.wire.message_class import class_of
from onebot_description.timing import NS_PER_S

_TIME = ("builtin_interfaces", "msg", "Time")
_HEADER = ("std_msgs", "msg", "Header")
_TRUE = ("true", "yes", "on", "1")
_FALSE = ("false", "no", "off", "0")
_LARGEST_FLOAT32 = 3.4028235677973366e38  # the smallest number that rounds to infinity


def is_message(value: Any) -> bool:
    """Whether ``value`` is a message, not a plain value of a field."""
    return hasattr(value, "get_fields_and_field_types")


def pick(message: Any, path: str) -> Any:
    """Return the part of a message at ``path``, such as ``transforms[0].transform.rotation``.

    Raises:
        OneBotError: there is no such field; lists the existing ones.
    """
    value = message
    for step in path.replace("[", ".[").split("."):
        value = _item(value, step, path) if step.startswith("[") else _field(value, step, path)
    return value


def _field(value: Any, name: str, path: str) -> Any:
    if not is_message(value):
        raise OneBotError(f'no field "{path}": there is nothing within a {type(value).__name__}')
    fields = value.get_fields_and_field_types()
    if name not in fields:
        raise OneBotError(
            f'no field "{path}": {type_name(value)} has no "{name}"'
            f"{did_you_mean(name, fields, 'fields')}"
        )
    return getattr(value, name)


def _item(value: Any, step: str, path: str) -> Any:
    try:
        return value[int(step.strip("[]"))]
    except (TypeError, ValueError, IndexError):
        raise OneBotError(f'no field "{path}": no item {step} there') from None


def fill(message: Any, text: str, *, finite: bool = True) -> list[Any]:
    """Set the fields of ``message`` that YAML text contains; the others are not changed.

    Args:
        message: the message.
        text: YAML such as ``{header: auto, twist: {linear: {x: 0.2}}}``.
        finite: reject infinities and NaN.

    Returns:
        The times that were given as ``now`` or ``auto``, for ``stamp`` to set when the message is
        sent.

    Raises:
        OneBotError: a value is invalid; names the field.
    """
    filler = _Filler(finite)
    filler.fields(message, _read_fields(text), "")
    return filler.times


def stamp(times: list[Any], nanoseconds: int) -> None:
    """Set each of ``times`` (builtin_interfaces/Time) to nanoseconds since the epoch."""
    for time in times:
        time.sec, time.nanosec = divmod(nanoseconds, NS_PER_S)


class _Filler:
    """Sets fields, and collects the times to be set when the message is published."""

    def __init__(self, finite: bool) -> None:
        self._finite = finite
        self.times: list[Any] = []

    def fields(self, message: Any, values: Mapping[str, Any], path: str) -> None:
        slots = dict(zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True))
        for name, value in values.items():
            if name not in slots:
                raise OneBotError(
                    f'{type_name(message)}{f" ({path})" if path else ""} has no field "{name}"'
                    f"{did_you_mean(name, slots, 'fields')}{_hint(name)}"
                )
            inner = f"{path}.{name}" if path else name
            setattr(message, name, self._value(slots[name], value, inner, getattr(message, name)))

    def _value(self, slot: Any, value: Any, path: str, current: Any) -> Any:
        if isinstance(slot, AbstractNestedType):
            return self._items(slot, value, path, current)
        if isinstance(slot, NamespacedType):
            return self._message(slot, value, path, current)
        if not isinstance(value, str):
            kind = "list" if isinstance(value, list) else "dictionary"
            raise OneBotError(f"{path} is one value ({slot_name(slot)}), not a {kind}")
        if isinstance(slot, AbstractGenericString):
            return value
        try:
            return read_scalar(slot.typename, value, self._finite)
        except ValueError as error:
            raise OneBotError(f"{path} {error}") from None

    def _message(self, slot: NamespacedType, value: Any, path: str, current: Any) -> Any:
        full = tuple(slot.namespaced_name())
        message = current if current is not None else class_of(slot)()
        if value == "auto" and full == _HEADER:
            self.times.append(message.stamp)
        elif value == "now" and full == _TIME:
            self.times.append(message)
        elif isinstance(value, Mapping):
            self.fields(message, value, path)
        elif value != "":
            fields = ", ".join(message.get_fields_and_field_types())
            what = "a list" if isinstance(value, list) else f'"{value}"'
            special = {_HEADER: ' or "auto"', _TIME: ' or "now"'}.get(full, "")
            raise OneBotError(
                f"{path} is a {'/'.join(full)}, a dictionary of {fields}{special}, not {what}"
            )
        return message

    def _items(self, slot: Any, values: Any, path: str, current: Any) -> Any:
        if values == "":
            values = []
        if not isinstance(values, list):
            raise OneBotError(f"{path} is a list of {slot_name(slot.value_type)}, written as [...]")
        if isinstance(slot, Array) and len(values) != slot.size:
            raise OneBotError(f"{path} has {slot.size} values, not {len(values)}")
        if isinstance(slot, BoundedSequence) and len(values) > slot.maximum_size:
            raise OneBotError(f"{path} has at most {slot.maximum_size} values, not {len(values)}")
        items = [
            self._value(slot.value_type, value, f"{path}[{index}]", None)
            for index, value in enumerate(values)
        ]
        if isinstance(current, np.ndarray):
            return np.array(items, dtype=current.dtype)
        if isinstance(current, array.array):
            return array.array(current.typecode, items)
        return items


def read_scalar(kind: str, text: str, finite: bool = True) -> Any:
    """Parse the value of a basic type.

    Args:
        kind: rosidl's name of the type (boolean, double, int32, octet, ...).
        text: the text of the value.
        finite: reject infinities and NaN.

    Raises:
        ValueError: it is invalid; the text continues a sentence that begins with the field's name.
    """
    if kind == "octet" and len(text) == 1 and not text.isdigit() and ord(text) < 256:
        return bytes([ord(text)])  # bytes are printed as characters
    text = text.strip()
    if kind == "boolean":
        return _boolean(text)
    if kind in ("float", "double", "long double"):
        return _floating(kind, text, finite)
    if kind == "octet":
        return bytes([_integer("uint8", text)])
    return _integer(kind, text)


def _boolean(text: str) -> bool:
    if text.lower() in _TRUE:
        return True
    if text.lower() in _FALSE:
        return False
    raise ValueError(f'is true or false, not "{text}"')


def _floating(kind: str, text: str, finite: bool) -> float:
    lower = text.lower().replace(".inf", "inf").replace(".nan", "nan")
    try:
        value = float(lower)
    except ValueError:
        raise ValueError(f'is a number, not "{text}"') from None
    if not math.isfinite(value):
        spelled = any(word in lower for word in ("inf", "nan"))
        if finite or not spelled:
            advice = "; --allow-non-finite accepts it" if spelled else ""
            raise ValueError(f'is a finite number, not "{text}"{advice}')
    elif kind == "float" and abs(value) >= _LARGEST_FLOAT32:
        raise ValueError(f"is a float32, which cannot hold {text}")
    return value


def _integer(kind: str, text: str) -> int:
    try:
        value = int(text) if text.lstrip("+-").isdigit() else int(text, 0)
    except ValueError:
        raise ValueError(f'is an integer ({kind}), not "{text}"') from None
    limits = np.iinfo(kind)
    if not limits.min <= value <= limits.max:
        raise ValueError(f"is an {kind} from {limits.min} to {limits.max}, not {text}")
    return value


def _read_fields(text: str) -> dict[str, Any]:
    """Parse the fields in YAML text; scalars stay strings, empty values are ""."""
    try:
        values = bounded_yaml.load(text, yaml.BaseLoader)
    except yaml.YAMLError as error:
        raise OneBotError(f"the values are invalid YAML: {_where(error)}{_hint(text)}") from None
    if values in (None, ""):
        return {}
    if not isinstance(values, dict) or not all(isinstance(key, str) for key in values):
        raise OneBotError(
            "the passed value needs to be a dictionary in YAML format, such as "
            f'"{{linear: {{x: 0.2}}}}", not: {text.strip()}{_hint(text)}'
        )
    return cast(dict[str, Any], values)


def _where(error: yaml.YAMLError) -> str:
    mark = getattr(error, "problem_mark", None)
    problem = getattr(error, "problem", None) or str(error).partition("\n")[0]
    return f"line {mark.line + 1}, column {mark.column + 1}: {problem}" if mark else str(problem)


def _hint(text: str) -> str:
    """Return a hint on the most common mistake, if the text has it."""
    return '; write a space after each ":"' if re.search(r"\w:\S", text) else ""
