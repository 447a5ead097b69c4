"""Fills a message of any type from YAML, strictly: what does not fit is an error, never cut off.

The form is ROS 2's. ``now`` for a time and ``auto`` for a header stand for the time of sending.
"""

import array
from collections.abc import Mapping
from typing import Any

import numpy as np
from rosidl_parser.definition import (
    AbstractGenericString,
    AbstractNestedType,
    AbstractSequence,
    Array,
    BasicType,
    BoundedSequence,
    NamespacedType,
)

from onebot_bringup.introspection.interfaces import nested_class, type_name
from onebot_bringup.introspection.scalars import read_scalar
from onebot_bringup.introspection.yaml_text import read_fields
from onebot_description.errors import OneBotError
from onebot_description.text import did_you_mean

_TIME = ("builtin_interfaces", "msg", "Time")
_HEADER = ("std_msgs", "msg", "Header")


def fill(message: Any, text: str, *, finite: bool = True) -> list[Any]:
    """Set the fields of ``message`` that YAML text names; the others stay.

    Args:
        message: of any type, or the request of a service.
        text: such as ``{header: auto, twist: {linear: {x: 0.2}}}``.
        finite: refuse infinities and NaN.

    Returns:
        The times within ``message`` that were given as ``now`` or ``auto``, to be set at sending
        (``stamp``).

    Raises:
        OneBotError: it is no YAML, or a field does not exist or is given a wrong value; the
            message names the field.
    """
    return fill_fields(message, read_fields(text), finite=finite)


def fill_fields(message: Any, fields: Mapping[str, Any], *, finite: bool = True) -> list[Any]:
    """Do as ``fill`` with a dictionary whose scalars are text."""
    filler = _Filler(finite)
    filler.fields(message, fields, "")
    return filler.times


def stamp(times: list[Any], nanoseconds: int) -> None:
    """Set each of ``times`` (builtin_interfaces/Time) to nanoseconds since the epoch."""
    for time in times:
        time.sec, time.nanosec = divmod(nanoseconds, 1_000_000_000)


class _Filler:
    def __init__(self, finite: bool) -> None:
        self._finite = finite
        self.times: list[Any] = []

    def fields(self, message: Any, values: Mapping[str, Any], path: str) -> None:
        slots = dict(zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True))
        for name, value in values.items():
            if name not in slots:
                space = '; write a space after each ":"' if ":" in name else ""
                raise OneBotError(
                    f'{type_name(message)}{f" ({path})" if path else ""} has no field "{name}"'
                    f"{did_you_mean(name, slots, 'fields')}{space}"
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
            raise OneBotError(f"{path} is one value ({_name(slot)}), not a {kind}")
        if isinstance(slot, AbstractGenericString):
            return _string(slot, value, path)
        try:
            return read_scalar(slot.typename, value, self._finite)
        except ValueError as error:
            raise OneBotError(f"{path} {error}") from None

    def _message(self, slot: NamespacedType, value: Any, path: str, current: Any) -> Any:
        full = tuple(slot.namespaced_name())
        message = current if current is not None else nested_class(slot)()
        if value == "auto" and full == _HEADER:
            self.times.append(message.stamp)
        elif value == "now" and full == _TIME:
            self.times.append(message)
        elif isinstance(value, Mapping):
            self.fields(message, value, path)
        elif value != "":
            fields = ", ".join(message.get_fields_and_field_types())
            given = "a list" if isinstance(value, list) else f'"{value}"'
            special = {_HEADER: ' or "auto"', _TIME: ' or "now"'}.get(full, "")
            raise OneBotError(
                f"{path} is a {'/'.join(full)}, a dictionary of {fields}{special}, not {given}"
            )
        return message

    def _items(self, slot: Any, values: Any, path: str, current: Any) -> Any:
        if values == "":
            values = []
        if not isinstance(values, list):
            raise OneBotError(f"{path} is a list of {_name(slot.value_type)}, written as [...]")
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


def _string(slot: Any, value: str, path: str) -> str:
    most = getattr(slot, "maximum_size", None)
    if most is not None and len(value) > most:
        raise OneBotError(f"{path} has at most {most} characters, not {len(value)}")
    return value


def _name(slot: Any) -> str:
    """What a field is, for people."""
    if isinstance(slot, BasicType):
        return str(slot.typename)
    if isinstance(slot, NamespacedType):
        return "/".join(slot.namespaced_name())
    if isinstance(slot, AbstractSequence):
        return f"list of {_name(slot.value_type)}"
    return "string"
