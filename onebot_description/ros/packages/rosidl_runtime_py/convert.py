"""Messages as dictionaries, as YAML and as comma-separated values."""

import sys
from array import array
from collections import OrderedDict
from collections.abc import Iterator
from typing import Any

import numpy as np
import yaml
from rosidl_parser.definition import AbstractWString, BasicType, NamespacedType

_LISTS = (list, tuple, array, np.ndarray)


def get_message_slot_types(msg: Any) -> "OrderedDict[str, Any]":
    """Return the types of a message's fields as types of rosidl_parser."""
    return OrderedDict(zip(msg.get_fields_and_field_types(), msg.SLOT_TYPES, strict=True))


def message_to_ordereddict(
    msg: Any, *, truncate_length: int | None = None, no_arr: bool = False, no_str: bool = False
) -> "OrderedDict[str, Any]":
    """Return the fields of a message, and of the messages in it, as dictionaries.

    Args:
        msg: the message.
        truncate_length: shorten texts and sequences to this length.
        no_arr: replace sequences by a text with type and length.
        no_str: replace texts by their length.
    """
    return OrderedDict(
        (name, plain(getattr(msg, name), kind, truncate_length, no_arr, no_str))
        for name, kind in get_message_slot_types(msg).items()
    )


def plain(value: Any, kind: Any, longest: int | None, no_arr: bool, no_str: bool) -> Any:
    """Return a value of a field, whose type is ``kind``; see ``message_to_ordereddict``."""
    if isinstance(value, _LISTS):
        if no_arr and kind is not None:
            return _summary(value, kind)
        parts = [plain(part, None, longest, no_arr, no_str) for part in value[:longest]]
        return parts if len(parts) == len(value) else [*parts, "..."]
    if isinstance(value, (str, bytes)):
        text = value.decode("latin-1") if isinstance(value, bytes) else value
        if no_str and isinstance(value, str):
            return f"<string length: <{len(text)}>>"
        return text if longest is None or len(text) <= longest else text[:longest] + "..."
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, (bool, float, int)):
        return value
    return message_to_ordereddict(value, truncate_length=longest, no_arr=no_arr, no_str=no_str)


def message_to_yaml(msg: Any, *, flow_style: bool = False, **options: Any) -> str:
    """Return the fields of a message as YAML, in one line with ``flow_style``.

    The other options are those of ``message_to_ordereddict``.
    """
    return yaml.dump(
        message_to_ordereddict(msg, **options),
        Dumper=_Dumper,
        allow_unicode=True,
        width=sys.maxsize,
        default_flow_style=flow_style,
    )


class _Dumper(yaml.SafeDumper):
    """Writes ordered dictionaries as plain ones, and repeated values in full."""

    def ignore_aliases(self, data: Any) -> bool:
        return True


_Dumper.add_representer(OrderedDict, lambda dumper, data: dumper.represent_dict(data.items()))


def message_to_csv(
    msg: Any, *, truncate_length: int | None = None, no_arr: bool = False, no_str: bool = False
) -> str:
    """Return all values of a message, or of a field, separated by commas, in order.

    An empty list is one empty value, so that later values stay in their columns. The options are
    those of ``message_to_ordereddict``.
    """
    return ",".join(_flat(plain(msg, None, truncate_length, no_arr, no_str)))


def _flat(value: Any) -> Iterator[str]:
    if isinstance(value, (dict, list)):
        for item in value.values() if isinstance(value, dict) else value or [""]:
            yield from _flat(item)
    else:
        yield str(value)


def _summary(value: Any, kind: Any) -> str:
    name = slot_name(kind.value_type)
    if hasattr(kind, "size"):
        return f"<array type: {name}[{kind.size}]>"
    bound = f"[{kind.maximum_size}]" if kind.has_maximum_size() else ""
    return f"<sequence type: {name}{bound}, length: {len(value)}>"


def slot_name(kind: Any) -> str:
    """Return the name of a field's type that is not a list, as in a .msg file."""
    if isinstance(kind, NamespacedType):
        return "/".join(kind.namespaced_name())
    if isinstance(kind, BasicType):
        return str(kind.typename)
    return "wstring" if isinstance(kind, AbstractWString) else "string"
