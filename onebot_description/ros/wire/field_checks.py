"""Checks values of message fields, and accepts the same ones as generated classes.

As in generated classes, values are checked only if ``ROS_PYTHON_CHECK_FIELDS`` is 1, or if
``check_fields=True`` is passed to a constructor.
"""

import array
from collections import UserList, UserString
from collections.abc import Callable, Sequence, Set
from typing import Any

import numpy as np
from rosidl_parser.definition import (
    AbstractGenericString,
    AbstractNestedType,
    AbstractType,
    Array,
    BasicType,
    BoundedSequence,
    NamespacedType,
)

# Types whose lists are arrays, by rosidl's names: letters that ``array``, ``struct`` and NumPy
# share.
NUMBERS = {
    **{"int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I"},
    **{"int64": "q", "uint64": "Q", "float": "f", "double": "d"},
}
_LARGEST_FLOAT = 3.402823466e38  # rosidl's bound

# Raises an AssertionError for a value that a field cannot have.
Check = Callable[[Any], None]
_Fits = Callable[[Any], bool]
_ClassOf = Callable[[NamespacedType], Any]


def check_of(name: str, slot: AbstractType, class_of: _ClassOf) -> Check:
    """Return the check of a field's values.

    Args:
        name: the field.
        slot: its type.
        class_of: returns the class of the messages in a field.
    """
    is_list = isinstance(slot, AbstractNestedType)
    fits, wanted = _list_rule(slot, class_of) if is_list else _rule(slot, class_of)
    is_byte = isinstance(slot, BasicType) and slot.typename == "octet"

    def check(value: Any) -> None:
        if not fits(value) or (is_byte and len(value) != 1):
            raise AssertionError(f"The '{name}' field must be {wanted}")

    return check


def _list_rule(slot: AbstractNestedType, class_of: _ClassOf) -> tuple[_Fits, str]:
    """Return the check of an array or a sequence, and the values that it accepts."""
    item_fits, wanted = _rule(slot.value_type, class_of)
    is_array, item = isinstance(slot, Array), slot.value_type
    letter = NUMBERS.get(item.typename) if isinstance(item, BasicType) else None
    least = slot.size if is_array else 0
    bounded = isinstance(slot, BoundedSequence)
    most = slot.size if is_array else slot.maximum_size if bounded else float("inf")

    def fits(value: Any) -> bool:
        if letter and is_array and isinstance(value, np.ndarray):
            return bool(value.dtype == np.dtype(letter) and value.size == slot.size)
        if letter and not is_array and isinstance(value, array.array):
            return value.typecode == letter and len(value) <= most
        is_many = isinstance(value, (Sequence, Set, UserList, array.array))
        return (
            is_many
            and not isinstance(value, (str, UserString))
            and least <= len(value) <= most
            and all(map(item_fits, value))
        )

    return fits, f"a set or sequence of {least} to {most} values, and each {wanted}"


def _rule(slot: AbstractType, class_of: _ClassOf) -> tuple[_Fits, str]:
    """Return the check of a single value, and the values that it accepts."""
    if isinstance(slot, NamespacedType):
        return lambda value: isinstance(value, class_of(slot)), f"a message of type '{slot.name}'"
    if isinstance(slot, AbstractGenericString):
        if not slot.has_maximum_size():
            return lambda value: isinstance(value, str), "of type 'str'"
        size = slot.maximum_size
        return (
            lambda value: isinstance(value, (str, UserString)) and len(value) <= size,
            f"a string value not longer than {size}",
        )
    kind = slot.typename
    if kind == "boolean":
        return lambda value: isinstance(value, bool), "of type 'bool'"
    if kind == "octet":
        return lambda value: isinstance(value, (bytes, bytearray)), "of type 'bytes' with length 1"
    if kind == "double":
        return lambda value: isinstance(value, float), "of type 'float'"
    if kind == "float":
        infinity = float("inf")
        return (
            lambda value: isinstance(value, float) and not _LARGEST_FLOAT < abs(value) < infinity,
            "a 32-bit 'float'",
        )
    low, high = np.iinfo(kind).min, np.iinfo(kind).max
    return (
        lambda value: isinstance(value, int) and low <= value <= high,
        f"an integer in [{low}, {high}]",
    )
