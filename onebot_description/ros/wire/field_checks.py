"""Checks values of message fields like generated classes, with the same AssertionErrors.

As in generated classes, values are checked only if ``ROS_PYTHON_CHECK_FIELDS`` is 1, or if
``check_fields=True`` is passed to a constructor.
"""

import array
import math
from collections import UserList, UserString
from collections.abc import Callable, Sequence, Set
from typing import Any, NamedTuple

import numpy as np
from rosidl_parser.definition import (
    AbstractGenericString,
    AbstractNestedType,
    AbstractSequence,
    AbstractType,
    Array,
    BasicType,
    BoundedSequence,
    NamespacedType,
)

# Raises an AssertionError for a value that a field cannot have.
Check = Callable[[Any], None]

_REALS = {
    "float": 3.402823466e38,
    "double": 1.7976931348623157e308,
}  # maximum, as in rosidl
_DTYPES = {"float": "float32", "double": "float64"}  # NumPy's names, where they differ


class _Item(NamedTuple):
    """The requirements for a single value, or for each value in a sequence."""

    is_type: Callable[[Any], bool]
    type_name: str
    fits: Callable[[Any], bool] = lambda value: True
    single: str = ""  # wording for a single value that does not fit
    each: str = ""  # wording for the values of a sequence


def check_of(name: str, slot: AbstractType, class_of: Callable[[NamespacedType], Any]) -> Check:
    """Return the check of a field's values.

    Args:
        name: the field.
        slot: its type.
        class_of: returns the class of the messages in a field.
    """
    if isinstance(slot, AbstractNestedType):
        return _check_of_many(name, slot, _item(slot.value_type, class_of))
    item = _item(slot, class_of)
    if isinstance(slot, NamespacedType):
        type_problem = f"must be a sub message of type '{item.type_name}'"
    elif item.type_name == "bytes":
        type_problem = "must be of type 'bytes' or 'ByteString' with length 1"
        item = item._replace(fits=lambda value: len(value) == 1)
    elif isinstance(slot, AbstractGenericString) and slot.has_maximum_size():
        type_problem = item.single
    else:
        type_problem = f"must be of type '{item.type_name}'"

    def check(value: Any) -> None:
        if not item.is_type(value):
            raise AssertionError(f"The '{name}' field {type_problem}")
        if not item.fits(value):
            raise AssertionError(f"The '{name}' field {item.single or type_problem}")

    return check


def _check_of_many(name: str, slot: AbstractNestedType, item: _Item) -> Check:
    """Return the check of an array or a sequence."""
    words, size_fits = ["a set or sequence"], _size_check(slot)
    if isinstance(slot, Array):
        words.append(f"with length {slot.size}")
    elif isinstance(slot, BoundedSequence):
        words.append(f"with length <= {slot.maximum_size}")
    if item.single and not item.each:  # a bounded string
        words.append(f"and each string value not longer than {slot.value_type.maximum_size}")
    words += [f"and each value of type '{item.type_name}'", *filter(None, [item.each])]
    check_numbers = _check_of_numbers(name, slot)

    def check(value: Any) -> None:
        if check_numbers and isinstance(value, (np.ndarray, array.array)) and check_numbers(value):
            return
        is_many = isinstance(value, (Sequence, Set, UserList, array.array))
        if not (
            is_many
            and not isinstance(value, (str, UserString))
            and size_fits(len(value))
            and all(item.is_type(each) and item.fits(each) for each in value)
        ):
            raise AssertionError(f"The '{name}' field must be {' '.join(words)}")

    return check


def _size_check(slot: AbstractNestedType) -> Callable[[int], bool]:
    if isinstance(slot, Array):
        return lambda size: bool(size == slot.size)
    if isinstance(slot, BoundedSequence):
        return lambda size: bool(size <= slot.maximum_size)
    return lambda size: True


def _check_of_numbers(name: str, slot: AbstractNestedType) -> Callable[[Any], bool] | None:
    """Return the check of arrays of numbers: True if it has passed, False for another kind."""
    item = slot.value_type
    if not isinstance(item, BasicType) or item.typename in ("boolean", "octet"):
        return None
    dtype = np.dtype(_DTYPES.get(item.typename, item.typename))
    code = {"l": "q", "L": "Q"}.get(dtype.char, dtype.char)  # of ``array``, whose "l" is C's long
    size_fits = _size_check(slot)

    def check(value: Any) -> bool:
        if isinstance(slot, Array) and isinstance(value, np.ndarray):
            kind = f"The '{name}' numpy.ndarray()"
            assert value.dtype == dtype, f"{kind} must have the dtype of 'numpy.{dtype.name}'"
            assert size_fits(value.size), f"{kind} must have a size of {slot.size}"
            return True
        if isinstance(slot, AbstractSequence) and isinstance(value, array.array):
            kind = f"The '{name}' array.array()"
            assert value.typecode == code, f"{kind} must have the type code of '{code}'"
            assert size_fits(len(value)), f"{kind} must have a size <= {slot.maximum_size}"
            return True
        return False

    return check


def _item(slot: AbstractType, class_of: Callable[[NamespacedType], Any]) -> _Item:
    if isinstance(slot, NamespacedType):
        return _Item(lambda value: isinstance(value, class_of(slot)), slot.name)
    if isinstance(slot, AbstractGenericString):
        if not slot.has_maximum_size():
            return _Item(lambda value: isinstance(value, str), "str")
        size = slot.maximum_size
        single = f"must be string value not longer than {size}"
        is_text = lambda value: isinstance(value, (str, UserString))  # noqa: E731
        return _Item(is_text, "str", lambda value: len(value) <= size, single)
    kind = slot.typename
    if kind == "boolean":
        return _Item(lambda value: isinstance(value, bool), "bool")
    if kind == "octet":
        is_bytes = lambda value: isinstance(value, (bytes, bytearray))  # noqa: E731
        return _Item(is_bytes, "bytes")
    if kind in _REALS:
        limit = _REALS[kind]
        return _Item(
            lambda value: isinstance(value, float),
            "float",
            lambda value: not (value < -limit or value > limit) or math.isinf(value),
            f"must be a {kind} in [{-limit}, {limit}]",
            f"and each {kind} in [{-limit:f}, {limit:f}]",
        )
    numbers = np.iinfo(kind)
    sign = "unsigned " if kind.startswith("u") else ""
    return _Item(
        lambda value: isinstance(value, int),
        "int",
        lambda value: bool(numbers.min <= value <= numbers.max),
        f"must be an {sign}integer in [{numbers.min}, {numbers.max}]",
        f"and each {sign}integer in [{numbers.min}, {numbers.max}]",
    )
