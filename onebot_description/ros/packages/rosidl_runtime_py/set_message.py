"""Fields of messages from dictionaries."""

from array import array
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from rosidl_parser.definition import AbstractNestedType, NamespacedType
from rosidl_runtime_py.convert import get_message_slot_types
from rosidl_runtime_py.import_message import import_message_from_namespaced_type


def set_message_fields(msg, values, expand_header_auto=False, expand_time_now=False) -> list[Any]:
    """Set fields of a message, and of the messages in it.

    Args:
        msg: the message.
        values: the value of each field; for a message, the values of its fields.
        expand_header_auto: whether "auto" as a header means a header with the current time.
        expand_time_now: whether "now" as a time means the current time.

    Returns:
        Functions to call with the current time, one for each such field.

    Raises:
        AttributeError: the message has no such field.
        TypeError: a value does not have its field's type.
    """
    setters: list[Any] = []

    def filled(message: Any, values: Any) -> Any:
        if isinstance(values, type(message)):
            return values
        if not isinstance(values, Mapping):
            kind = type(values).__name__
            raise TypeError(f"Value '{values}' is expected to be a dictionary but is a {kind}")
        slots = get_message_slot_types(message)
        for name, value in values.items():
            field = getattr(message, name)
            kind = type(field).__name__
            if expand_header_auto and value == "auto" and kind == "Header":
                setters.append(partial(setattr, field, "stamp"))
            elif expand_time_now and value == "now" and kind == "Time":
                setters.append(partial(setattr, message, name))
            else:
                setattr(message, name, converted(slots[name], field, value))
        return message

    def converted(slot: Any, field: Any, value: Any) -> Any:
        if isinstance(field, array):
            return array(field.typecode, value)
        if isinstance(field, np.ndarray):
            return np.array(value, field.dtype)
        if isinstance(slot, NamespacedType):
            return filled(type(field)(), value)
        item = slot.value_type if isinstance(slot, AbstractNestedType) else None
        if isinstance(item, NamespacedType):
            make = import_message_from_namespaced_type(item)
            return [filled(make(), part) for part in value]
        return value if type(value) is type(field) else type(field)(value)

    filled(msg, values)
    return setters
