"""Reads the definition of a message type as rosbag2 and MCAP store it ("ros2msg").

It is the text of the .msg file, followed by the texts of the types in it, each after a line of
``=`` and a line ``MSG: package/Name``.
"""

import re
from collections.abc import Iterator
from typing import Any, NamedTuple

from onebot_description.errors import printable, shortened

NUMBERS = {  # NumPy's names
    **{"bool": "?", "byte": "u1", "char": "u1", "float32": "<f4", "float64": "<f8"},
    **{
        f"{sign}int{8 * size}": f"<{sign or 'i'}{size}"
        for sign in ("", "u")
        for size in (1, 2, 4, 8)
    },
}
STRINGS = {"string": 1, "wstring": 2}  # bytes per character
_KNOWN = {  # some writers leave them out
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec",
    "builtin_interfaces/Duration": "int32 sec\nuint32 nanosec",
}
_SECTION = re.compile(r"^={3,}[ \t\r]*\nMSG:[ \t]*(\S*)[ \t\r]*(?:\n|\Z)", re.MULTILINE)
_TYPE = re.compile(r"[A-Za-z]\w*/(?:msg/)?[A-Za-z]\w*", re.ASCII)
_FIELD = re.compile(
    r"(?P<type>[A-Za-z]\w*(?:/[A-Za-z]\w*){0,2})(?:<=\d+)?"
    r"(?P<array>\[(?:(?P<size>[1-9]\d{0,9})|(?:<=\d+)?)\])?\s+"
    r"(?P<name>[A-Za-z]\w*)(?![^\s=])\s*(?P<constant>=)?",
    re.ASCII,
)


class DefinitionError(ValueError):
    """A definition that cannot be used; ``str(error)`` names the type and the line."""


class Field(NamedTuple):
    """A line of a .msg file that defines a field."""

    name: str
    type: str  # one of NUMBERS or STRINGS, or package/Name
    size: int | None  # an array's; 0: a sequence; None: a single value
    where: str  # type, line and text, for a message


def short_name(name: str) -> str:
    """Return ``package/Name`` of a message type."""
    if not _TYPE.fullmatch(name):
        raise DefinitionError(f'"{printable(shortened(name))}" is not the name of a message type')
    return name.replace("/msg/", "/")


def section(kind: str, text: str) -> str:
    """Return a part of a definition: the .msg file of a type by ``package/Name``."""
    return f"\n{'=' * 80}\nMSG: {kind}\n{text}"


def files(name: str, definition: str) -> dict[str, str]:
    """Split the definition of a type of this short name into .msg files, by ``package/Name``."""
    first, *parts = _SECTION.split(definition)
    sections = zip(parts[::2], parts[1::2], strict=True)
    texts = _KNOWN | {kind.replace("/msg/", "/"): text for kind, text in sections}
    return texts | {name: first} if first.strip() or name not in texts else texts


def fields(kind: str, text: str) -> Iterator[Field]:
    """Parse the .msg file of a type; constants and defaults are left out."""
    names = set[str]()
    for number, line in enumerate(text.split("\n"), 1):
        line = line.partition("#")[0].strip()
        if not line:
            continue
        where = f'{kind}, line {number}: "{printable(shortened(line))}"'
        match = _FIELD.match(line)
        if match is None:
            raise DefinitionError(
                f"{where} is not a field of a .msg file, such as `float64[3] point`"
            )
        name = match["name"]
        size = int(match["size"] or 0) if match["array"] else None
        if match["constant"]:
            continue
        if name in names:
            raise DefinitionError(f"{where}: an earlier field has this name")
        names.add(name)
        yield Field(name, _full(match["type"], kind), size, where)


def _full(name: str, home: str) -> str:
    """Return the name of a type with its package, by default that of ``home``."""
    if name in NUMBERS or name in STRINGS:
        return name
    return name.replace("/msg/", "/") if "/" in name else f"{home.partition('/')[0]}/{name}"


def type_name(message: Any) -> str:
    """Return ``package/msg/Type`` of a message or of its class."""
    kind = message if isinstance(message, type) else type(message)
    package, folder, *_ = kind.__module__.split(".")
    return f"{package}/{folder}/{kind.__name__}"
