"""Makes classes of messages like those that rosidl generates, from their fields at run time.

They have the same attributes, constructor, properties and text as generated classes, so that rclpy
and generic tools accept them. As in generated classes, the types of values are checked when a
message is sent, and on assignment only if ``ROS_PYTHON_CHECK_FIELDS`` is set.
"""

import array
import copy
import functools
import importlib
import operator
import os
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from rosidl_parser.definition import (
    AbstractGenericString,
    AbstractNestedType,
    AbstractType,
    AbstractWString,
    Array,
    BasicType,
    BoundedSequence,
    NamespacedType,
)

from onebot_description.ros.wire.field_checks import NUMBERS, check_of

_DEFAULTS = {"boolean": False, "octet": b"\0", "float": 0.0, "double": 0.0}  # 0 for others
_IS_CHECKED = os.environ.get("ROS_PYTHON_CHECK_FIELDS") == "1"
_CAPSULES = (
    "_CREATE_ROS_MESSAGE",
    "_CONVERT_FROM_PY",
    "_CONVERT_TO_PY",
    "_DESTROY_ROS_MESSAGE",
    "_TYPE_SUPPORT",
)


class MessageField(NamedTuple):
    """A field of a message.

    Attributes:
        name: as in the definition.
        type: its type, as in ``SLOT_TYPES`` of a generated class.
        default: its value in a new message, as in the definition; None: rosidl's default.
    """

    name: str
    type: AbstractType
    default: Any = None


_MADE: dict[str, Any] = {}  # classes made so far, by full name


def full_name(slot: NamespacedType) -> str:
    """Return ``package/msg/Type`` of a field's type."""
    return "/".join(slot.namespaced_name())


def item_of(slot: AbstractType) -> AbstractType:
    """Return the type of the values in an array or a sequence; return other types unchanged."""
    return slot.value_type if isinstance(slot, AbstractNestedType) else slot


def size_of(slot: AbstractType) -> int:
    """Return the size of an array, or the maximum size of a sequence; 0 if unbounded."""
    if isinstance(slot, Array):
        return int(slot.size)
    return int(slot.maximum_size) if isinstance(slot, BoundedSequence) else 0


def class_of(slot: NamespacedType) -> Any:
    """Return the class of the messages in a field: made here, or generated."""
    message_class = made_class(full_name(slot))
    return message_class or getattr(importlib.import_module(".".join(slot.namespaces)), slot.name)


def module_name(name: str) -> str:
    """Return the module of a type's generated code, by the type's full name."""
    package, folder, short = name.split("/")
    stem = re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", short.split("_")[0])
    return f"{package}.{folder}._{stem.lower()}"


def make_metaclass(
    name: str, load: Callable[[Any], None], constants: Mapping[str, Any] | None = None
) -> Any:
    """Return a metaclass that holds a type's support where rclpy looks for it.

    ``constants`` are read-only attributes of its class.
    """
    classes: list[Any] = []

    def remember(cls: Any, *_args: Any, **_kwargs: Any) -> None:
        classes.append(cls)

    def import_type_support(metaclass: Any) -> None:
        """Load the type support, once."""
        if metaclass._TYPE_SUPPORT is None:
            load(classes[0])

    attributes = {
        **dict.fromkeys(_CAPSULES),
        "__init__": remember,
        "__import_type_support__": classmethod(import_type_support),
        **{key: _constant(value) for key, value in (constants or {}).items()},
    }
    return type(f"Metaclass_{name}", (type,), attributes)


def _constant(value: Any) -> property:
    return property(lambda _: copy.copy(value))


def made_class(name: str) -> Any:
    """Return a class made before, by its full name, including parts of services and actions.

    It is None if there is none.
    """
    return _MADE.get(name)


def keep_class(name: str, made: Any) -> Any:
    """Register a class for ``made_class`` by its full name; return the class."""
    _MADE[name] = made
    return made


def make_message_class(
    name: str,
    fields: Sequence[MessageField],
    constants: Mapping[str, Any],
    load: Callable[[Any], None],
) -> Any:
    """Return the class of a message type.

    Args:
        name: ``package/msg/Type``; for a part of a service or an action, srv or action.
        fields: its fields; the classes of nested messages exist.
        constants: their values by name.
        load: called once with the class; sets the capsules that rclpy looks for on its metaclass.
    """
    package, folder, short = name.split("/")
    names = [field.name for field in fields]
    makers = [(field.name, _default(field)) for field in fields]
    constants = {**constants, **_default_constants(fields)}

    def __init__(self: Any, **kwargs: Any) -> None:
        self._check_fields = kwargs.get("check_fields", _IS_CHECKED)
        if self._check_fields and (unknown := kwargs.keys() - {*names, "check_fields"}):
            text = ", ".join(sorted(unknown))
            raise AssertionError(f"Invalid arguments passed to constructor: {text}")
        for field, make in makers:
            setattr(self, field, kwargs[field] if field in kwargs else make())

    def __repr__(self: Any) -> str:
        texts = (f"{field}={_text(getattr(self, field))}" for field in names)
        return f"{package}.{folder}.{short}({', '.join(texts)})"

    def __eq__(self: Any, other: object) -> bool:
        return isinstance(other, message_class) and all(
            _equal(getattr(self, field), getattr(other, field)) for field in names
        )

    types = {field.name: _type_name(field.type) for field in fields}
    attributes = {
        "__doc__": f"Message class '{short}'.",
        "__module__": module_name(name),
        "__slots__": [*(f"_{field}" for field in names), "_check_fields"],
        "__hash__": None,
        "SLOT_TYPES": tuple(field.type for field in fields),
        "_fields_and_field_types": types,
        "get_fields_and_field_types": classmethod(lambda _: types.copy()),
        **{function.__name__: function for function in (__init__, __repr__, __eq__)},
        **{field.name: _property(field) for field in fields},
        **constants,
    }
    message_class = make_metaclass(short, load, constants)(short, (), attributes)
    return keep_class(name, message_class)


def _default_constants(fields: Sequence[MessageField]) -> dict[str, Any]:
    return {
        f"{field.name.upper()}__DEFAULT": _converter(field.type)(field.default)
        for field in fields
        if field.default is not None
    }


def _text(value: Any) -> str:
    if isinstance(value, array.array):
        return repr(value.tolist())
    return repr(value)


def _equal(one: Any, other: Any) -> bool:
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return bool(np.array_equal(one, other))
    return bool(one == other)


# ---- Fields ----


def _property(field: MessageField) -> property:
    """Return the property of a field."""
    where, convert = f"_{field.name}", _converter(field.type)
    check = functools.cache(lambda: check_of(field.name, field.type, class_of))  # rarely needed

    def assign(message: Any, value: Any) -> None:
        if message._check_fields:
            check()(value)
        setattr(message, where, convert(value))

    return property(operator.attrgetter(where), assign, doc=f"Message field '{field.name}'.")


def _letter(slot: AbstractType) -> str | None:
    """Return the letter of the numbers in an array or a sequence; None for other types."""
    item = item_of(slot)
    return NUMBERS.get(item.typename) if item is not slot and isinstance(item, BasicType) else None


def _converter(slot: AbstractType) -> Callable[[Any], Any]:
    """Return the function that converts an assigned value to the stored one."""
    if not (letter := _letter(slot)):
        return lambda value: value
    if isinstance(slot, Array):
        return functools.partial(np.array, dtype=letter)
    return functools.partial(array.array, letter)


def _default(field: MessageField) -> Callable[[], Any]:
    """Return the function that creates the value of a field in a new message."""
    slot, default = field.type, field.default
    if isinstance(slot, NamespacedType):
        return lambda: class_of(slot)()
    if isinstance(slot, Array) and default is None:
        item = _default(MessageField("", slot.value_type))
        return lambda: [item() for _ in range(slot.size)]
    if isinstance(slot, AbstractNestedType):
        return lambda: list(default or ())
    if default is None:
        text = isinstance(slot, AbstractGenericString)
        default = "" if text else _DEFAULTS.get(slot.typename, 0)
    return lambda: default


def _type_name(slot: AbstractType) -> str:
    """Return a field's type as named by ``get_fields_and_field_types``."""
    if isinstance(slot, AbstractNestedType):
        item = _type_name(slot.value_type)
        if isinstance(slot, Array):
            return f"{item}[{slot.size}]"
        bound = f", {slot.maximum_size}" if isinstance(slot, BoundedSequence) else ""
        return f"sequence<{item}{bound}>"
    if isinstance(slot, NamespacedType):
        return f"{slot.namespaces[0]}/{slot.name}"
    if isinstance(slot, BasicType):
        return str(slot.typename)
    bound = f"<{slot.maximum_size}>" if slot.has_maximum_size() else ""
    return ("wstring" if isinstance(slot, AbstractWString) else "string") + bound
