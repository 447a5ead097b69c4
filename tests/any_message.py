"""Messages of any type and any content, for property tests."""

import math
import time
from collections.abc import Sequence
from inspect import signature
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from hypothesis import strategies as st
from hypothesis.extra.numpy import from_dtype
from rclpy.serialization import deserialize_message, serialize_message
from rosidl_parser.definition import (
    AbstractGenericString,
    AbstractNestedType,
    Array,
    BasicType,
    BoundedSequence,
    NamespacedType,
)
from sensor_msgs.msg import JointState

from onebot_description.ros.wire.message_class import class_of

# Ordinary numbers, too: most of what reacts at all reacts to messages that are nearly right.
_NUMBERS = [0.0, 0.5, -1.0, 1e6, 1e300, 1.7e308, -1.7e308, math.nan, math.inf]
_doubles = st.sampled_from(_NUMBERS) | st.floats(width=64)
_NUMBER = {  # by IDL's name; those of integers are numpy's, too
    "double": _doubles,
    "float": st.floats(width=32),
    "boolean": st.booleans(),
    "octet": st.binary(min_size=1, max_size=1),
}
_characters = st.characters(exclude_categories=("Cs",), exclude_characters="\0")
_LATEST = (2**31 - 1, 2**32 - 1)
_times = st.sampled_from([_LATEST, (0, 0), (10**9, 5), (-(2**31), 0), (-1, 10**9)]) | st.tuples(
    st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**32 - 1)
)


def messages(kind: Any, names: Sequence[str] = ()) -> st.SearchStrategy[Any]:
    """Messages of the class ``kind``; strings in it are often one of ``names``."""
    return _values(kind, names).map(lambda values: _filled(kind, values))


def _filled(kind: Any, values: dict[str, Any]) -> Any:
    message = kind()
    for name, value in values.items():
        setattr(message, name, value)
    return message


def _values(kind: Any, names: Sequence[str]) -> st.SearchStrategy[dict[str, Any]]:
    if kind is Time:
        return _times.map(lambda time: {"sec": time[0], "nanosec": time[1]})
    slots = dict(zip(kind.get_fields_and_field_types(), kind.SLOT_TYPES, strict=True))
    values = st.fixed_dictionaries({name: _value(slot, names) for name, slot in slots.items()})
    return st.builds(_of_equal_length, values, st.integers(0, 3)) if kind is JointState else values


def _of_equal_length(values: dict[str, Any], chosen: int) -> dict[str, Any]:
    """Mostly as many positions as names, and as many or no velocities: others are ignored."""
    if not chosen:
        return values
    count, kept = len(values["name"]), {"position": values["position"] or [0.5]}
    kept |= {what: values[what] for what in ("velocity", "effort")}
    return {**values, **{what: (given * count)[:count] for what, given in kept.items()}}


def _value(slot: Any, names: Sequence[str]) -> st.SearchStrategy[Any]:
    if isinstance(slot, BasicType):
        return _number(slot.typename)
    if isinstance(slot, AbstractGenericString):
        return _strings(names)
    if isinstance(slot, NamespacedType):
        return messages(class_of(slot), names)
    assert isinstance(slot, AbstractNestedType)
    item = _value(slot.value_type, names)
    if isinstance(slot, Array):
        return st.lists(item, min_size=slot.size, max_size=slot.size)
    most = 3 if isinstance(slot.value_type, NamespacedType) else 6  # at each depth: 3, 9, 27, ...
    if isinstance(slot, BoundedSequence):
        most = min(most, slot.maximum_size)
    return st.lists(item, max_size=most)


def _number(kind: str) -> st.SearchStrategy[Any]:
    return _NUMBER[kind] if kind in _NUMBER else from_dtype(np.dtype(kind)).map(int)


def _strings(names: Sequence[str]) -> st.SearchStrategy[str]:
    some = st.text(_characters, max_size=20) | st.sampled_from(["", "/", "x" * 10_000])
    return st.sampled_from(names) | some if names else some


def broken(draw: Any, data: bytes) -> bytes:
    """``data``, sometimes cut, longer, of another encoding, or with other bytes somewhere."""
    if draw(st.integers(0, 3)):
        return data
    place = draw(st.integers(0, len(data)))
    other = draw(st.binary(max_size=12))
    return data[:place] + other + draw(st.sampled_from([data[place + len(other) :], b"", data]))


def received(subscription: Any, data: bytes) -> None:
    """Call a subscription's callback as the executor does when ``data`` comes.

    Where it takes no raw bytes, what is no message of the type does not get as far as Python.
    """
    if subscription.raw:
        subscription.callback(data)
        return
    try:
        message = deserialize_message(data, subscription.msg_type)
    except Exception:  # of many kinds
        return
    now = time.time_ns()
    info = {"source_timestamp": now, "received_timestamp": now, "publication_sequence_number": None}
    takes_info = len(signature(subscription.callback).parameters) == 2
    subscription.callback(message, *([info] if takes_info else []))


def serialized(message: Any) -> bytes:
    """Return the bytes of a message on the wire."""
    return bytes(serialize_message(message))
