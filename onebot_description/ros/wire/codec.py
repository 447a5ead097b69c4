"""Serializes message objects to CDR and back, for message classes made at run time.

The writer of a type follows from ``SLOT_TYPES`` of its class, and is compiled once. ``Schema``
reads messages, column by column; cdr.py describes the layout.
"""

import array
import functools
import struct
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
from rosidl_parser.definition import (
    AbstractGenericString,
    AbstractNestedType,
    AbstractType,
    AbstractWString,
    Array,
    BasicType,
    NamespacedType,
)

from onebot_description.ros.wire.definition import section
from onebot_description.ros.wire.field_checks import NUMBERS
from onebot_description.ros.wire.message_class import class_of, full_name, item_of
from onebot_description.ros.wire.schema import Schema

# Appends the CDR of a message, or of a field's value, to a body.
Write = Callable[[bytearray, Any], None]
# Returns the values of a field, one for each row of its column.
Read = Callable[[Any], Iterable[Any]]

_LETTERS = NUMBERS | {"boolean": "?", "octet": "c"}  # formats of ``struct``
_MSG_TYPES = {"boolean": "bool", "octet": "byte", "float": "float32", "double": "float64"}
_LENGTH = struct.Struct("<I")


def _fields(kind: Any) -> Iterator[tuple[str, AbstractType]]:
    """Return the names and types of a message class's fields."""
    return zip(kind.get_fields_and_field_types(), kind.SLOT_TYPES, strict=True)


# ---- Objects to bytes ----


def pack(kind: Any, message: Any) -> bytes:
    """Return the CDR of a message of a class, without its encapsulation.

    A TypeError, AttributeError or UnicodeEncodeError names the field that does not fit.
    """
    body = bytearray()
    try:
        _writer(kind)(body, message)
    except struct.error as error:
        raise TypeError(f"{kind.__name__}: {error}") from error
    return bytes(body)


@functools.cache
def _writer(kind: Any) -> Write:
    writers = [(name, _value_writer(slot)) for name, slot in _fields(kind)]
    if not writers:
        return lambda body, _message: body.append(0)  # an empty struct takes a byte

    def write(body: bytearray, message: Any) -> None:
        for name, write_value in writers:
            write_value(body, getattr(message, name))

    return write


def _value_writer(slot: AbstractType) -> Write:
    if isinstance(slot, NamespacedType):
        return _writer(class_of(slot))
    if isinstance(slot, AbstractGenericString):
        return _write_wide_text if isinstance(slot, AbstractWString) else _write_text
    if isinstance(slot, BasicType):
        return _number_writer(_LETTERS[slot.typename])
    item = slot.value_type
    write_items = (
        _items_writer(_LETTERS[item.typename])
        if isinstance(item, BasicType)
        else functools.partial(_write_each, _value_writer(item))
    )
    if isinstance(slot, Array):
        return functools.partial(_write_array, write_items, slot.size)
    return functools.partial(_write_sequence, write_items)


def _number_writer(letter: str) -> Write:
    size, pack_number = struct.calcsize(letter), struct.Struct("<" + letter).pack

    def write(body: bytearray, value: Any) -> None:
        body += bytes(-len(body) % size)
        body += pack_number(value)

    return write


def _write_text(body: bytearray, text: str) -> None:
    data = str.encode(text).partition(b"\0")[0]  # rclpy keeps strings in C, where NUL ends them
    _write_length(body, len(data) + 1)
    body += data + b"\0"


def _write_wide_text(body: bytearray, text: str) -> None:
    data = str.encode(text, "utf-16-le")
    _write_length(body, len(data) // 2)
    body += data


def _write_length(body: bytearray, length: int) -> None:
    body += bytes(-len(body) % _LENGTH.size)
    body += _LENGTH.pack(length)


def _items_writer(letter: str) -> Write:
    size = struct.calcsize(letter)

    def write(body: bytearray, values: Any) -> None:
        if len(values):
            body += bytes(-len(body) % size)
            data = np.asarray(values, "S1" if letter == "c" else letter)
            body += data.tobytes()

    return write


def _write_each(write: Write, body: bytearray, values: Iterable[Any]) -> None:
    for value in values:
        write(body, value)


def _write_array(write: Write, size: int, body: bytearray, values: Any) -> None:
    if len(values) != size:
        raise TypeError(f"an array of {size} has {len(values)} values")
    write(body, values)


def _write_sequence(write: Write, body: bytearray, values: Any) -> None:
    _write_length(body, len(values))
    write(body, values)


# ---- Bytes to objects ----


def unpack(kind: Any, schema: Schema, data: bytes) -> Any:
    """Return the message of a class from its CDR, including encapsulation.

    ``schema`` is the class's, from ``schema_of``. Raises WireError for other bytes.
    """
    return _objects(kind, schema.read_table(data))[0]


def _objects(kind: Any, table: Any) -> list[Any]:
    """Return the messages in the rows of a table."""
    messages = [kind() for _ in range(len(table))]
    for name, read_column in _readers(kind):
        for message, value in zip(messages, read_column(table[name]), strict=True):
            setattr(message, name, value)
    return messages


@functools.cache
def _readers(kind: Any) -> list[tuple[str, Read]]:
    return [(name, _reader(slot)) for name, slot in _fields(kind)]


def _reader(slot: AbstractType) -> Read:
    if isinstance(slot, NamespacedType):
        return functools.partial(_objects, class_of(slot))
    if isinstance(slot, AbstractGenericString):
        return lambda column: column
    if isinstance(slot, BasicType):
        if slot.typename == "octet":
            return _octets
        return lambda column: column.tolist()
    inner = _list_reader(slot)
    return lambda column: map(inner, column)


def _list_reader(slot: AbstractNestedType) -> Callable[[Any], Any]:
    """Return the function that makes an array or a sequence from a column of its items."""
    item = slot.value_type
    letter = NUMBERS.get(item.typename) if isinstance(item, BasicType) else None
    if letter is None:
        read_items = _reader(item)
        return lambda items: list(read_items(items))
    if isinstance(slot, Array):
        return np.copy
    return lambda items: array.array(letter, items.tobytes())


def _octets(column: Any) -> list[bytes]:
    return [bytes([number]) for number in column.tolist()]


# ---- The schema of a class ----


def schema_of(kind: Any, name: str) -> Schema:
    """Return the schema that reads messages of a class; ``name``: the full name of its type."""
    sections: dict[str, str] = {}
    _add_sections(kind, name, sections)
    texts = (section(inner, text) for inner, text in sections.items())
    return Schema(_short(name), "".join(texts))


def _short(name: str) -> str:
    """Return ``package/Type`` of a full name."""
    package, _, kind = name.split("/")
    return f"{package}/{kind}"


def _add_sections(kind: Any, name: str, sections: dict[str, str]) -> None:
    """Add the .msg text of a class and of the types in it, by short name."""
    if _short(name) in sections:
        return
    sections[_short(name)] = "\n".join(
        f"{_msg_type(slot)} {field}" for field, slot in _fields(kind)
    )
    for _, slot in _fields(kind):
        if isinstance(item := item_of(slot), NamespacedType):
            _add_sections(class_of(item), full_name(item), sections)


def _msg_type(slot: AbstractType) -> str:
    """Return a field's type as in a .msg file, without upper bounds."""
    if isinstance(slot, AbstractNestedType):
        size = slot.size if isinstance(slot, Array) else ""
        return f"{_msg_type(slot.value_type)}[{size}]"
    if isinstance(slot, NamespacedType):
        return _short(full_name(slot))
    if isinstance(slot, BasicType):
        return _MSG_TYPES.get(slot.typename, str(slot.typename))
    return "wstring" if isinstance(slot, AbstractWString) else "string"
