"""Messages as text, as ``ros2 topic echo`` prints them: YAML, or values separated by commas."""

import array
import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml
from rosidl_parser.definition import (
    AbstractNestedType,
    AbstractString,
    AbstractWString,
    Array,
    BasicType,
    BoundedSequence,
    NamespacedType,
)

from onebot_bringup.introspection.interfaces import type_name
from onebot_description.errors import OneBotError
from onebot_description.text import did_you_mean

_LISTS = (list, tuple, array.array, np.ndarray)


@dataclass(frozen=True)
class Style:
    """How messages are shown.

    Attributes:
        longest: lists, bytes and strings are cut after so many items; None shows all.
        arrays: show the items of lists; otherwise their type and length.
        strings: show strings; otherwise their length.
        flow: YAML on one line, with braces.
    """

    longest: int | None = 128
    arrays: bool = True
    strings: bool = True
    flow: bool = False


class _Dumper(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:
        """Write everything out, even what occurs twice."""
        return True


def to_yaml(message: Any, style: Style | None = None) -> str:
    """Return a message as YAML, ending with a newline."""
    style = style or Style()
    return yaml.dump(
        to_dict(message, style),
        Dumper=_Dumper,
        allow_unicode=True,
        width=sys.maxsize,
        sort_keys=False,
        default_flow_style=style.flow,
    )


def to_csv(message: Any, style: Style | None = None) -> str:
    """Return all values within a message (or a part of it), separated by commas, in order."""
    return ",".join(_flat(message, None, style or Style()))


def pick(message: Any, path: str) -> Any:
    """Return the part of a message that ``path`` names, such as ``pose.pose.position``.

    An index picks an item of a list: ``transforms[0].transform``, ``position[1]``.

    Raises:
        OneBotError: there is no such field; the message lists those there are.
    """
    value = message
    for step in path.replace("[", ".[").split("."):
        value = _item(value, step, path) if step.startswith("[") else _field(value, step, path)
    return value


def _field(value: Any, name: str, path: str) -> Any:
    if not is_message(value):
        raise OneBotError(f'no field "{path}": there is nothing within a {type(value).__name__}')
    fields = value.get_fields_and_field_types()
    if name not in fields:
        raise OneBotError(
            f'no field "{path}": {type_name(value)} has no "{name}"'
            f"{did_you_mean(name, fields, 'fields')}"
        )
    return getattr(value, name)


def _item(value: Any, step: str, path: str) -> Any:
    try:
        return value[int(step.strip("[]"))]
    except (TypeError, ValueError):
        raise OneBotError(f'no field "{path}": no item {step} there') from None
    except IndexError:
        raise OneBotError(f'no item "{path}": the list has {len(value)}') from None


def is_message(value: Any) -> bool:
    """Tell messages from the values of their fields."""
    return hasattr(value, "get_fields_and_field_types")


def to_dict(message: Any, style: Style) -> dict[str, Any]:
    """Return a message as a dictionary of plain values, fields in their order."""
    fields = message.get_fields_and_field_types()
    return {
        name: _plain(getattr(message, name), slot, style)
        for name, slot in zip(fields, message.SLOT_TYPES, strict=True)
    }


def _plain(value: Any, slot: Any, style: Style) -> Any:
    if isinstance(value, bytes):
        return _cut("".join(map(chr, value)), style)
    if isinstance(value, str):
        return _cut(value, style) if style.strings else _length(value)
    if isinstance(value, _LISTS):
        if not style.arrays and isinstance(slot, AbstractNestedType):
            return _summary(value, slot)
        return _plain_list(value, lambda item: _plain(item, None, style), style)
    if isinstance(value, np.generic):
        return value.item()
    return to_dict(value, style) if is_message(value) else value


def _plain_list(values: Any, plain: Callable[[Any], Any], style: Style) -> list[Any]:
    if style.longest is None or len(values) <= style.longest:
        return [plain(value) for value in values]
    return [*(plain(value) for value in values[: style.longest]), "..."]


def _flat(value: Any, slot: Any, style: Style) -> list[str]:
    if isinstance(value, _LISTS):
        if not style.arrays and isinstance(slot, AbstractNestedType):
            return [_summary(value, slot)]
        shown = value if style.longest is None else value[: style.longest]
        items = [text for item in shown for text in _flat(item, None, style)]
        return items if len(shown) == len(value) else [*items, "..."]
    if is_message(value):
        names = value.get_fields_and_field_types()
        slots = zip(names, value.SLOT_TYPES, strict=True)
        return [text for name, kind in slots for text in _flat(getattr(value, name), kind, style)]
    if isinstance(value, str):
        return [_cut(value, style) if style.strings else _length(value)]
    if isinstance(value, bytes):
        return [str(value)]
    return [str(value.item() if isinstance(value, np.generic) else value)]


def _cut(text: str, style: Style) -> str:
    if style.longest is None or len(text) <= style.longest:
        return text
    return text[: style.longest] + "..."


def _length(text: str) -> str:
    return f"<string length: <{len(text)}>>"


def _summary(values: Any, slot: Any) -> str:
    """What stands for a list whose items are not shown."""
    kind = _name(slot.value_type)
    if isinstance(slot, Array):
        return f"<array type: {kind}[{slot.size}]>"
    bound = f"[{slot.maximum_size}]" if isinstance(slot, BoundedSequence) else ""
    return f"<sequence type: {kind}{bound}, length: {len(values)}>"


def _name(slot: Any) -> str:
    if isinstance(slot, BasicType):
        return str(slot.typename)
    if isinstance(slot, AbstractString):
        return "string"
    if isinstance(slot, AbstractWString):
        return "wstring"
    return "/".join(slot.namespaced_name()) if isinstance(slot, NamespacedType) else "unknown"
