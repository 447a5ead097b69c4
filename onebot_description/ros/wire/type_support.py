"""Connects classes that are made at run time to the middleware, with _type_support.c.

If that is not possible, a TypeSupportError says what to do.
"""

import ctypes
import functools
import os
from collections.abc import Sequence
from typing import Any

from rosidl_parser.definition import (
    EMPTY_STRUCTURE_REQUIRED_MEMBER_NAME,
    AbstractGenericString,
    AbstractWString,
    BasicType,
    BoundedSequence,
    NamespacedType,
)

from onebot_description.compiled.library import load_library
from onebot_description.errors import OneBotError
from onebot_description.ros.wire.codec import pack, schema_of, unpack
from onebot_description.ros.wire.message_class import (
    MessageField,
    class_of,
    full_name,
    item_of,
    size_of,
)
from onebot_description.ros.wire.type_description import (
    Definition,
    Facts,
    describe,
    facts_of,
    other_support,
)

_DISTRO = "jazzy"  # the structures of this ROS are repeated here and in C
_INTROSPECTION = "rosidl_typesupport_introspection_c"
# A type without fields has this one in C, and in its description.
EMPTY = MessageField(EMPTY_STRUCTURE_REQUIRED_MEMBER_NAME, BasicType("uint8"))

_FACTS: dict[Any, Facts] = {}  # facts of classes that were made at run time
_KEPT: list[Any] = []  # memory that the library continues to read


class TypeSupportError(OneBotError, ImportError):
    """A type that was made at run time cannot be used; ``str(error)`` says what to do."""


class _Member(ctypes.Structure):
    """A field, from rosidl_typesupport_introspection_c."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("type_id", ctypes.c_uint8),
        ("string_upper_bound", ctypes.c_size_t),
        ("members", ctypes.c_void_p),
        ("is_key", ctypes.c_bool),
        ("is_array", ctypes.c_bool),
        ("array_size", ctypes.c_size_t),
        ("is_upper_bound", ctypes.c_bool),
        ("offset", ctypes.c_uint32),
        ("default_value", ctypes.c_void_p),
        ("functions", ctypes.c_void_p * 6),
    )


# rosidl_typesupport_introspection_c/field_types.h
_IDS = {
    name: number
    for number, name in enumerate(
        "float double longdouble char wchar boolean octet uint8 int8 uint16 int16 uint32 int32 "
        "uint64 int64 string wstring message".split(),
        1,
    )
}


# ---- Messages, services, actions ----


def support_message(kind: Any, definition: Definition) -> None:
    """Make a message class ready for rclpy."""
    library = _library()
    nested = {
        full_name(item): class_of(item)
        for field in definition.fields
        if isinstance(item := item_of(field.type), NamespacedType)
    }
    facts = describe(definition, map(_facts, nested.values()))
    members = (_Member * len(definition.fields))(
        *(_member(field, nested) for field in definition.fields)
    )
    schema = schema_of(kind, definition.name)
    own_pack = functools.partial(pack, kind)
    own_unpack = functools.partial(unpack, kind, schema)
    package, folder, name = definition.name.split("/")
    names = f"{package}::{folder}".encode(), f"{package}__{folder}".encode(), name.encode()
    handle = library.onebot_types_message(
        *names, ctypes.byref(facts), len(members), members, *schema.program, own_pack, own_unpack
    )
    # rclpy calls it with the interpreter lock.
    create = ctypes.PYFUNCTYPE(ctypes.c_void_p)(
        functools.partial(library.onebot_types_create, library.onebot_types_of(handle))
    )
    _keep(kind, facts, members, schema, own_pack, own_unpack, names, create)
    metaclass = type(kind)
    metaclass._CREATE_ROS_MESSAGE = _capsule(create)
    metaclass._CONVERT_FROM_PY = _capsule(library.onebot_types_convert_from_py)
    metaclass._CONVERT_TO_PY = _capsule(library.onebot_types_convert_to_py)
    metaclass._DESTROY_ROS_MESSAGE = _capsule(library.onebot_types_destroy)
    metaclass._TYPE_SUPPORT = _capsule(handle)


def support_service(kind: Any, definition: Definition) -> None:
    """Make a service class ready for rclpy."""
    parts = kind.Request, kind.Response, kind.Event
    facts = describe(definition, map(_facts, parts))
    package, folder, name = definition.name.split("/")
    names = f"{package}::{folder}".encode(), name.encode()
    _keep(kind, facts, names)
    type(kind)._TYPE_SUPPORT = _capsule(
        _library().onebot_types_service(*names, ctypes.byref(facts), *map(handle_of, parts))
    )


def support_action(kind: Any, definition: Definition) -> None:
    """Make an action class ready for rclpy."""
    parts = kind.Impl
    described = kind.Goal, kind.Result, kind.Feedback
    services = parts.SendGoalService, parts.GetResultService
    facts = describe(definition, map(_facts, (*described, *services, parts.FeedbackMessage)))
    _keep(kind, facts)
    used = *services, parts.CancelGoalService, parts.FeedbackMessage, parts.GoalStatusMessage
    type(kind)._TYPE_SUPPORT = _capsule(
        _library().onebot_types_action(ctypes.byref(facts), *map(handle_of, used))
    )


def _keep(kind: Any, facts: Facts, *others: Any) -> None:
    _FACTS[kind] = facts
    _KEPT.append(others)


def _facts(kind: Any) -> Facts:
    """Return the facts of a type, made at run time or generated."""
    handle = handle_of(kind)
    return _FACTS[kind] if kind in _FACTS else facts_of(handle)


def _member(field: MessageField, nested: dict[str, Any]) -> _Member:
    """Return a field's entry; ``nested``: the classes of messages in fields, by full name."""
    slot, item = field.type, item_of(field.type)
    members = None
    kind = "message"
    if isinstance(item, BasicType):
        kind = item.typename
    elif isinstance(item, AbstractGenericString):
        kind = "wstring" if isinstance(item, AbstractWString) else "string"
    else:
        members = other_support(handle_of(nested[full_name(item)]), _INTROSPECTION)
    return _Member(
        name=field.name.encode(),
        type_id=_IDS[kind],
        string_upper_bound=getattr(item, "maximum_size", 0),
        members=members,
        is_array=item is not slot,
        array_size=size_of(slot),
        is_upper_bound=isinstance(slot, BoundedSequence),
    )


def handle_of(kind: Any) -> int:
    """Return the address of a class's type support, which is loaded if necessary."""
    if type(kind)._TYPE_SUPPORT is None:
        type(kind).__import_type_support__()
    get = ctypes.pythonapi.PyCapsule_GetPointer
    get.restype, get.argtypes = ctypes.c_void_p, [ctypes.py_object, ctypes.c_char_p]
    address: int = get(type(kind)._TYPE_SUPPORT, None)
    return address


def _capsule(symbol: Any) -> Any:
    """Wrap the address of a C function or structure, the way rclpy expects it."""
    new = ctypes.pythonapi.PyCapsule_New
    new.restype, new.argtypes = ctypes.py_object, [ctypes.c_void_p] * 3
    return new(ctypes.cast(symbol, ctypes.c_void_p), None, None)


# ---- The library ----


@functools.cache
def _library() -> ctypes.PyDLL:
    """Return the library, connected to the type supports of std_msgs."""
    from std_msgs.msg import UInt8, UInt16, UInt32, UInt64

    distro = os.environ.get("ROS_DISTRO", _DISTRO)
    # A sourced ROS sets both variables; a Docker image sets only ROS_DISTRO.
    if "ROS_VERSION" in os.environ and distro != _DISTRO:
        raise _unfit(f"it is {distro}")
    library = load_library()
    address, text, size = ctypes.c_void_p, ctypes.c_char_p, ctypes.c_uint32
    functions: dict[str, Sequence[Any]] = {
        "message": (
            *[text] * 3,
            *[address, size, address],
            *[text, size],
            *[ctypes.py_object] * 2,
        ),
        "of": (address,),
        "create": (address,),
        "service": (text, text, *[address] * 4),
        "action": [address] * 6,
    }
    for name, arguments in functions.items():
        function = library[f"onebot_types_{name}"]
        function.restype, function.argtypes = address, arguments
        setattr(library, f"onebot_types_{name}", function)
    configure(library, [handle_of(kind) for kind in (UInt8, UInt16, UInt32, UInt64)])
    return library


def configure(library: ctypes.PyDLL, handles: Sequence[int]) -> None:
    """Make the library use the type supports of UInt8, UInt16, UInt32 and UInt64."""
    library.onebot_types_configure.restype = ctypes.c_char_p
    problem = library.onebot_types_configure((ctypes.c_void_p * len(handles))(*handles))
    if problem is not None:
        raise _unfit(problem.decode())


def _unfit(detail: str) -> TypeSupportError:
    return TypeSupportError(
        f"the types here are built for ROS 2 Jazzy, but the installed ROS differs: {detail}. "
        "Install the ros-jazzy-* packages that onebot asks for, or the tf2_msgs of the other ROS."
    )
