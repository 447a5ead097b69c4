"""Describes types as in REP-2011, and hashes the description (RIHS01), a type's identity.

The structures are those of rosidl_runtime_c in ROS 2 Jazzy; type ids are those of
type_description_interfaces/msg/FieldType.
"""

import ctypes
import hashlib
import json
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

from rosidl_parser.definition import (
    AbstractType,
    Array,
    BasicType,
    BoundedSequence,
    BoundedString,
    BoundedWString,
    NamespacedType,
    UnboundedSequence,
    UnboundedString,
    UnboundedWString,
)

from onebot_description.ros.wire.message_class import MessageField, full_name, item_of, size_of

_NESTED = 1
_BASIC = (
    "int8 uint8 int16 uint16 int32 uint32 int64 uint64 float double longdouble char wchar boolean "
    "octet"
).split()
_IDS = {name: number for number, name in enumerate(_BASIC, 2)}
_STRINGS = {UnboundedString: 17, UnboundedWString: 18, BoundedString: 21, BoundedWString: 22}
_LISTS = {Array: 48, BoundedSequence: 96, UnboundedSequence: 144}


class _String(ctypes.Structure):
    _fields_ = (
        ("data", ctypes.c_char_p),
        ("size", ctypes.c_size_t),
        ("capacity", ctypes.c_size_t),
    )


class _FieldType(ctypes.Structure):
    _fields_ = (
        ("type_id", ctypes.c_uint8),
        ("capacity", ctypes.c_uint64),
        ("string_capacity", ctypes.c_uint64),
        ("nested_type_name", _String),
    )


class _Field(ctypes.Structure):
    _fields_ = (("name", _String), ("type", _FieldType), ("default_value", _String))


def _sequence(item: type) -> Any:
    """Return the structure of a sequence of structures."""
    fields = [
        ("data", ctypes.POINTER(item)),
        ("size", ctypes.c_size_t),
        ("capacity", ctypes.c_size_t),
    ]
    return type(f"{item.__name__}Sequence", (ctypes.Structure,), {"_fields_": fields})


_Fields = _sequence(_Field)


class _Individual(ctypes.Structure):
    _fields_ = (("type_name", _String), ("fields", _Fields))


_Individuals = _sequence(_Individual)


class _Description(ctypes.Structure):
    _fields_ = (("type", _Individual), ("referenced", _Individuals))


class _Source(ctypes.Structure):
    _fields_ = (("type_name", _String), ("encoding", _String), ("contents", _String))


_Sources = _sequence(_Source)


class _Hash(ctypes.Structure):
    _fields_ = (("version", ctypes.c_uint8), ("value", ctypes.c_uint8 * 32))


class Facts(ctypes.Structure):
    """``struct facts`` in _type_support.c: a type's hash, description and sources."""

    _fields_ = (
        ("hash", _Hash),
        ("description", ctypes.POINTER(_Description)),
        ("sources", ctypes.POINTER(_Sources)),
    )


class _Handle(ctypes.Structure):
    """The type support of a message, from rosidl_runtime_c."""

    _fields_ = (
        ("identifier", ctypes.c_char_p),
        ("data", ctypes.c_void_p),
        ("func", ctypes.CFUNCTYPE(ctypes.c_void_p, ctypes.c_void_p, ctypes.c_char_p)),
        ("get_type_hash", ctypes.CFUNCTYPE(ctypes.POINTER(_Hash), ctypes.c_void_p)),
        ("get_description", ctypes.CFUNCTYPE(ctypes.POINTER(_Description), ctypes.c_void_p)),
        ("get_sources", ctypes.CFUNCTYPE(ctypes.POINTER(_Sources), ctypes.c_void_p)),
    )


class Definition(NamedTuple):
    """The definition of a type.

    Attributes:
        name: ``package/msg/Type``, or with srv or action.
        fields: fields of a message; those of services and actions are defined in REP-2011.
        encoding: encoding of the text: msg, srv or action; "implicit" without text.
        text: text of the file that defines it.
    """

    name: str
    fields: Sequence[MessageField]
    encoding: str = "implicit"
    text: str = ""


def facts_of(handle: int) -> Facts:
    """Return the facts of a message type, by the address of its type support."""
    support = _Handle.from_address(handle)
    description, sources = support.get_description(handle), support.get_sources(handle)
    return Facts(support.get_type_hash(handle).contents, description, sources)


def other_support(handle: int, identifier: str) -> int | None:
    """Return the address of another type support of a message, such as that for introspection."""
    address: int | None = _Handle.from_address(handle).func(handle, identifier.encode())
    return address


def describe(definition: Definition, nested: Iterable[Facts]) -> Facts:
    """Return the facts of a type; ``nested``: the facts of the types in its fields."""
    individual = _individual(definition)
    source = _Source(*map(_string, (definition.name, definition.encoding, definition.text)))
    parts: dict[bytes, tuple[_Individual, _Source]] = {}
    for facts in nested:
        description, sources = facts.description.contents, facts.sources.contents
        individuals = [description.type, *_items(description.referenced)]
        texts = {item.type_name.data: item for item in _items(sources)}
        parts |= {item.type_name.data: (item, texts[item.type_name.data]) for item in individuals}
    referenced = [parts[name] for name in sorted(parts)]
    description = _Description(individual, _made(_Individuals, [item for item, _ in referenced]))
    sources = _made(_Sources, [source, *(text for _, text in referenced)])
    digest = hashlib.sha256(json.dumps(_as_json(description)).encode()).digest()
    hash_ = _Hash(1, (ctypes.c_uint8 * 32)(*digest))
    return Facts(hash_, ctypes.pointer(description), ctypes.pointer(sources))


def _items(sequence: Any) -> list[Any]:
    return [sequence.data[index] for index in range(sequence.size)]


def _made(kind: Any, items: Sequence[Any]) -> Any:
    """Return a sequence of structures."""
    item = kind._fields_[0][1]._type_
    return kind((item * len(items))(*items), len(items), len(items))


def _string(text: str) -> _String:
    data = text.encode()
    return _String(data, len(data), len(data)) if data else _String()


def _individual(definition: Definition) -> _Individual:
    fields = [
        _Field(
            _string(field.name),
            _field_type(field.type),
            _string("" if field.default is None else str(field.default)),
        )
        for field in definition.fields
    ]
    return _Individual(_string(definition.name), _made(_Fields, fields))


def _field_type(slot: AbstractType) -> _FieldType:
    item, capacity, offset = item_of(slot), size_of(slot), _LISTS.get(type(slot), 0)
    if isinstance(item, NamespacedType):
        return _FieldType(_NESTED + offset, capacity, 0, _string(full_name(item)))
    number = _IDS[item.typename] if isinstance(item, BasicType) else _STRINGS[type(item)]
    return _FieldType(number + offset, capacity, getattr(item, "maximum_size", 0), _String())


def _as_json(description: _Description) -> dict[str, Any]:
    """Return the description that is hashed: without default values."""
    referenced = [_individual_as_json(item) for item in _items(description.referenced)]
    return {
        "type_description": _individual_as_json(description.type),
        "referenced_type_descriptions": referenced,
    }


def _individual_as_json(individual: _Individual) -> dict[str, Any]:
    fields = [
        {
            "name": field.name.data.decode(),
            "type": {
                "type_id": field.type.type_id,
                "capacity": field.type.capacity,
                "string_capacity": field.type.string_capacity,
                "nested_type_name": (field.type.nested_type_name.data or b"").decode(),
            },
        }
        for field in _items(individual.fields)
    ]
    return {"type_name": individual.type_name.data.decode(), "fields": fields}
