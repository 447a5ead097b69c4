"""Messages as dictionaries and as YAML."""

import sys
from array import array
from collections import OrderedDict
from typing import Any

import numpy as np
from rosidl_parser.definition import AbstractWString, BasicType, NamespacedType


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

    def plain(value: Any, kind: Any = None) -> Any:
        if isinstance(value, (list, tuple, array, np.ndarray)):
            if no_arr and kind is not None:
                return _abbreviated(value, kind)
            cut = value[:truncate_length]
            parts = [plain(part) for part in cut] + ["..."] * (len(cut) < len(value))
            return tuple(parts) if isinstance(value, tuple) else parts
        if isinstance(value, (str, bytes)):
            text = value.decode("latin-1") if isinstance(value, bytes) else value
            if no_str and isinstance(value, str):
                return f"<string length: <{len(text)}>>"
            return text[:truncate_length] + "..." * (len(text[:truncate_length]) < len(text))
        if isinstance(value, np.number):
            return value.item()
        return value if isinstance(value, (bool, float, int)) else fields(value)

    def fields(message: Any) -> "OrderedDict[str, Any]":
        kinds = get_message_slot_types(message)
        return OrderedDict((name, plain(getattr(message, name), kinds[name])) for name in kinds)

    return fields(msg)


def message_to_yaml(
    msg: Any,
    *,
    truncate_length: int | None = None,
    no_arr: bool = False,
    no_str: bool = False,
    flow_style: bool = False,
) -> str:
    """Return the fields of a message as YAML, in one line with ``flow_style``."""
    import yaml

    class Dumper(yaml.Dumper):
        """Writes ordered dictionaries as plain ones."""

    Dumper.add_representer(OrderedDict, lambda dumper, data: dumper.represent_dict(data.items()))
    fields = message_to_ordereddict(
        msg, truncate_length=truncate_length, no_arr=no_arr, no_str=no_str
    )
    return yaml.dump(
        fields, Dumper=Dumper, allow_unicode=True, width=sys.maxsize, default_flow_style=flow_style
    )


def _abbreviated(value: Any, kind: Any) -> str:
    item = kind.value_type
    if isinstance(item, NamespacedType):
        name = "/".join(item.namespaced_name())
    elif isinstance(item, BasicType):
        name = item.typename
    else:
        name = "wstring" if isinstance(item, AbstractWString) else "string"
    if hasattr(kind, "size"):
        return f"<array type: {name}[{kind.size}]>"
    bound = f"[{kind.maximum_size}]" if kind.has_maximum_size() else ""
    return f"<sequence type: {name}{bound}, length: {len(value)}>"
