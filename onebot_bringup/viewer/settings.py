"""Settings as dataclasses: read from YAML with clear errors, listed and changed one by one.

Each field is a ``setting``. A dataclass among them is a group of settings; their names are joined
by dots, such as ``axes.visible``, which is also the name of the ROS parameter.
"""

import re
from collections.abc import Callable, Mapping
from dataclasses import Field, field, fields, is_dataclass, replace
from typing import Any, TypeVar

from onebot_description.description.description import Triple
from onebot_description.errors import did_you_mean

Color = tuple[int, int, int]
Value = bool | float | str | list[float] | list[int] | list[str]
Check = Callable[[Any, str], Any]  # value and its name -> the checked value, or ValueError
T = TypeVar("T")

_CHECK = "check"


def setting(default: Any, description: str, check: Check | None = None) -> Any:
    """Return a dataclass field.

    Args:
        default: its value where none is given.
        description: what it does, with its unit.
        check: by default what suits a bool, a float of at least 0, or a text.
    """
    return field(
        default=default, metadata={"description": description, _CHECK: check or _check_of(default)}
    )


def group(kind: type) -> Any:
    """Return a dataclass field that is a group of settings of its own."""
    return field(default_factory=kind)


def named(kind: type) -> Any:
    """Return a dataclass field: a mapping from names, freely chosen, to what has a topic."""
    return field(default_factory=dict, metadata={_CHECK: _named(kind)})


# --- checks of values ---------------------------------------------------------------------------

# Relative, so that a namespace applies; absolute only where it is written so.
_TOPIC = re.compile(r"/?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", re.ASCII)


def boolean(value: object, where: str) -> bool:
    """Check true or false."""
    if not isinstance(value, bool):
        raise ValueError(f'{where} must be true or false, not "{value}"')
    return value


def length(value: Any, where: str) -> float:
    """Check a number of at least 0."""
    if not _is_number(value) or not 0 <= value < float("inf"):
        raise ValueError(f'{where} must be a number of at least 0, such as 0.5, not "{value}"')
    return float(value)


def height(value: Any, where: str) -> float:
    """Check metres up, or down if negative."""
    if not _is_number(value) or not abs(value) < float("inf"):
        raise ValueError(f'{where} must be metres, such as -0.05, not "{value}"')
    return float(value)


def text(value: object, where: str) -> str:
    """Check a name."""
    if not isinstance(value, str):
        raise ValueError(f'{where} must be a name, not "{value}"')
    return value


def name_list(value: Any, where: str) -> tuple[str, ...]:
    """Check a list of names."""
    if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
        raise ValueError(
            f'{where} must be a list of names, such as [odom, base_link], not "{value}"'
        )
    return tuple(value)


def topic(value: object, where: str) -> str:
    """Check the name of a topic."""
    if not isinstance(value, str) or not _TOPIC.fullmatch(value):
        raise ValueError(
            f'{where} must be a topic, such as velocity_controller/odom, not "{value}"'
        )
    return value


def topic_list(value: Any, where: str) -> tuple[str, ...]:
    """Check a list of names of topics."""
    if not isinstance(value, list):
        raise ValueError(f'{where} must be a list of topics, such as [plan], not "{value}"')
    return tuple(topic(name, f"{where}[{at}]") for at, name in enumerate(value))


def vector(value: Any, where: str) -> Triple | None:
    """Check three metres, or nothing."""
    if value is None or value == []:
        return None
    numbers = isinstance(value, list) and len(value) == 3 and all(map(_is_number, value))
    if not numbers or not all(abs(number) < float("inf") for number in value):
        raise ValueError(f'{where} must be three metres, such as [3.0, -3.0, 2.0], not "{value}"')
    return float(value[0]), float(value[1]), float(value[2])


def color(value: Any, where: str) -> Color | None:
    """Check three sRGB bytes, or nothing."""
    if value is None or value == []:
        return None
    three = isinstance(value, list) and len(value) == 3
    if not three or not all(type(number) is int and 0 <= number <= 255 for number in value):
        raise ValueError(f'{where} must be three bytes, such as [48, 48, 48], not "{value}"')
    return value[0], value[1], value[2]


def one_of(*choices: str) -> Check:
    """Return the check of a word."""

    def check(value: object, where: str) -> str:
        if value not in choices:
            raise ValueError(f'{where} must be one of {", ".join(choices)}, not "{value}"')
        return str(value)

    return check


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _check_of(default: object) -> Check:
    if isinstance(default, bool):
        return boolean
    return length if isinstance(default, float) else text


# --- dataclasses of settings --------------------------------------------------------------------


def read(kind: type[T], content: object, where: str = "") -> T:
    """Build the dataclass ``kind`` from a mapping.

    Args:
        kind: its fields are made by ``setting``, ``group`` and ``named``.
        content: as YAML has it.
        where: the name of the group; "" for a whole file.

    Raises:
        ValueError: an entry is wrong; names it, and says what would be right.
    """
    entries = _entries(kind)
    if not isinstance(content, Mapping):
        known = ", ".join(entries)
        raise ValueError(f'{where or "the file"} must be "key: value" lines, with {known}')
    values = {}
    for key, value in content.items():
        name = f"{where}.{key}" if where else str(key)
        if key not in entries:
            raise ValueError(f'unknown key "{name}"{did_you_mean(str(key), list(entries))}')
        values[key] = _checked(entries[key], value, name)
    return kind(**values)


def _named(kind: type[T]) -> Check:
    def check(content: Any, where: str) -> dict[str, T]:
        if not isinstance(content, Mapping):
            raise ValueError(f'{where} must be "name: {{topic: ...}}" lines')
        found = {}
        for name, entry in content.items():
            path = f"{where}.{name}"
            if not isinstance(name, str) or not name:
                raise ValueError(f"{path}: a name must be text")
            found[name] = read(kind, entry, path)
            if "topic" not in entry:
                raise ValueError(f"{path} has no topic")
        return found

    return check


def _entries(kind: Any) -> dict[str, Field[Any]]:
    return {entry.name: entry for entry in fields(kind)}


def _checked(entry: Field[Any], value: object, name: str) -> object:
    check: Check | None = entry.metadata.get(_CHECK)
    if check is None:
        group: Any = entry.default_factory
        return read(group, value, name)
    return check(value, name)


def values(config: Any, prefix: str = "") -> dict[str, Value]:
    """Return every single setting by its dotted name; one that is left open is an empty list.

    Named items (trails, ...) are no single settings: their names are the user's own.
    """
    found: dict[str, Value] = {}
    for entry in fields(config):
        value, name = getattr(config, entry.name), prefix + entry.name
        if is_dataclass(value):
            found |= values(value, f"{name}.")
        elif not isinstance(value, Mapping):
            found[name] = [] if value is None else plain(value)
    return found


def with_setting(config: T, name: str, value: Any) -> T:
    """Return ``config`` with another value of the setting ``name``, as a view file would have it.

    Raises:
        ValueError: there is no such setting, or it cannot have that value.
    """
    return _replaced(config, name.split("."), value, name)


def _replaced(config: T, path: list[str], value: Any, name: str) -> T:
    entries = _entries(config) if is_dataclass(config) else {}
    if path[0] not in entries:
        raise ValueError(f'there is no setting "{name}"')
    current = getattr(config, path[0])
    if len(path) > 1:
        new = _replaced(current, path[1:], value, name)
    elif is_dataclass(current) or isinstance(current, Mapping):
        raise ValueError(f'"{name}" is more than one setting')
    else:
        new = _checked(entries[path[0]], value, name)
    changed: T = replace(config, **{path[0]: new})  # type: ignore[type-var]
    return changed


def different(config: Any, usual: Any) -> dict[str, Any]:
    """Return the entries of a dataclass that are not as in ``usual``, as YAML has them."""
    found: dict[str, Any] = {}
    for entry in fields(config):
        value, other = getattr(config, entry.name), getattr(usual, entry.name)
        if value == other:
            continue
        if is_dataclass(value):
            found[entry.name] = different(value, other)
        elif isinstance(value, Mapping):
            items = value.items()
            found[entry.name] = {name: different(item, type(item)()) for name, item in items}
        else:
            found[entry.name] = plain(value)
    return found


def plain(value: Any) -> Any:
    """Return a value as YAML has it: tuples as lists."""
    return list(value) if isinstance(value, tuple) else value
