"""Parses untrusted XML; every fault in it becomes one clear DescriptionError.

Each document is parsed here before any other parser sees it. DOCTYPE, and with it entity bombs and
external entities, and excessive nesting are rejected. The line of every element is recorded.
"""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn
from xml.etree import ElementTree
from xml.parsers import expat

from onebot_description.errors import DescriptionError, did_you_mean

XACRO_NAMESPACES = (
    "http://www.ros.org/wiki/xacro",
    "http://ros.org/wiki/xacro",
    "http://wiki.ros.org/xacro",
    "https://www.ros.org/wiki/xacro",
)
_GAZEBO_PREFIXES, _GAZEBO_NAMESPACE = ("gz", "ignition"), "http://gazebosim.org/schema"
_SEPARATOR = "\1"  # between namespace, name and prefix; no document can contain it
# A comment, with its text, or a CDATA section, which may contain text like a comment. The end of
# the document ends either, so that the time stays linear.
_COMMENT = re.compile(rb"<!--(.*?)(-->|\Z)|<!\[CDATA\[.*?(?:\]\]>|\Z)", re.DOTALL)
MAX_BYTES = 50_000_000
_MAX_NESTED = 100
_MAX_PARTS = 1_000_000  # elements and attributes; 10,000 joints take a fifth of that


@dataclass(frozen=True)
class Document:
    """A parsed document and where its elements were written."""

    root: ElementTree.Element
    places: dict[ElementTree.Element, str]  # ``file:line`` of each element, in document order
    shown: str  # its name in messages
    folder: Path | None  # folder of relative paths; None for text without a file
    has_xacro: bool = False  # whether the xacro namespace is declared


def shown_path(path: str | Path) -> str:
    """Return ``path`` for messages: relative if it is below the current folder."""
    try:
        relative = os.path.relpath(path)
    except (OSError, ValueError):
        return str(path)
    return str(path) if relative.startswith(os.pardir) else relative


def read_bytes(path: Path) -> bytes:
    """Return the content of a file.

    Raises:
        DescriptionError: it is missing, too large, unreadable, or not a regular file.
    """
    name = shown_path(path)
    try:
        if not path.is_file():  # a pipe would block the reader, a device may never end
            raise DescriptionError([missing_file(path)])
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise DescriptionError([f"{name}: cannot be read: {reason}"]) from None
    if len(data) > MAX_BYTES:
        raise DescriptionError([f"{name}: is larger than {MAX_BYTES // 1_000_000} MB"])
    return data


def missing_file(path: Path) -> str:
    """Return the message about a missing file, with the files that exist."""
    name = shown_path(path)
    if path.is_dir():
        return f"{name}: is a folder; name the file{_choices(path, '')}"
    if path.exists():
        return f"{name}: is a device or pipe, not a file"
    return f"{name}: no such file{_choices(path.parent, path.name)}"


def _choices(folder: Path, name: str) -> str:
    """Return what to write instead of ``name``: similar files in ``folder``."""
    try:
        return did_you_mean(name, os.listdir(folder), "in that folder")
    except OSError:
        return ""


def mended(data: bytes, shown: str) -> tuple[bytes, tuple[str, ...]]:
    """Repair what urdfdom accepts but XML forbids; elements stay on their lines.

    Blank lines before an XML declaration are moved behind it, comments with "--" inside are
    emptied, and prefixes of Gazebo's namespace are declared.

    Returns:
        The document, and a warning for each change.
    """
    warnings = []
    document = data.lstrip(b" \t\r\n")
    blank, end = data[: len(data) - len(document)], document.find(b"?>") + 2
    if blank and document.startswith(b"<?xml ") and end >= 2:
        data = document[:end] + blank + document[end:]
        text = "blank lines before <?xml ...?>, which some programs reject: delete them"
        warnings.append(f"{shown}:1: {text}")
    if dashed := next(filter(_is_dashed, _COMMENT.finditer(data)), None):
        line = data.count(b"\n", 0, dashed.start()) + 1
        text = '"--" inside a comment, which some programs reject: delete it'
        warnings.append(f"{shown}:{line}: {text}")
        data = _COMMENT.sub(_emptied, data)
    for prefix in filter(lambda prefix: b"%s:" % prefix.encode() in data, _GAZEBO_PREFIXES):
        bare = _COMMENT.sub(_emptied, data)  # as long as the document
        used = re.search(rb"<([^<>]*\s)?%s:\w" % prefix.encode(), bare)
        root = re.search(rb"<robot(?=[\s/>])", bare)
        if used and root and f"xmlns:{prefix}".encode() not in bare:
            declared = f'<robot xmlns:{prefix}="{_GAZEBO_NAMESPACE}"'
            line = data.count(b"\n", 0, used.end()) + 1
            text = f"the prefix {prefix} is not declared, which some programs reject: write"
            warnings.append(f"{shown}:{line}: {text} {declared} ...>")
            data = data[: root.start()] + declared.encode() + data[root.end() :]
    return data, tuple(warnings)


def _emptied(comment: re.Match[bytes]) -> bytes:
    """Return a comment without its text, on as many lines; return anything else unchanged."""
    if comment[1] is None:
        return comment[0]
    return b"<!--" + re.sub(rb"[^\r\n]", b" ", comment[1]) + comment[2]


def _is_dashed(comment: re.Match[bytes]) -> bool:
    """Return whether it is a comment with "--" inside."""
    return bool(comment[1]) and (b"--" in comment[1] or comment[1].endswith(b"-"))


def parse(
    data: bytes, shown: str, folder: Path | None = None, encoding: str | None = None
) -> Document:
    """Parse XML without DOCTYPE.

    Args:
        data: the document.
        shown: its name in messages.
        folder: where relative paths start.
        encoding: overrides the encoding that the document declares.

    Raises:
        DescriptionError: it cannot be parsed; the text has line and column.
    """
    parser = expat.ParserCreate(encoding, namespace_separator=_SEPARATOR)
    parser.namespace_prefixes = True
    parser.buffer_text = True
    tree = ElementTree.TreeBuilder()
    places: dict[ElementTree.Element, str] = {}
    namespaces: set[str] = set()
    opened: list[tuple[str, int]] = []  # the elements around the place, each with its line
    parts = 0

    def place() -> str:
        return f"{shown}:{parser.CurrentLineNumber}"

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal parts
        opened.append((name, parser.CurrentLineNumber))
        parts += 1 + len(attributes)
        if parts > _MAX_PARTS:
            text = f"has more than {_MAX_PARTS} elements and attributes"
            raise DescriptionError([f"{place()}: {text}"])
        if len(opened) > _MAX_NESTED:
            raise DescriptionError([f"{place()}: elements are nested deeper than {_MAX_NESTED}"])
        element = tree.start(_tag(name), {_tag(key): text for key, text in attributes.items()})
        places[element] = place()

    def end(name: str) -> None:
        opened.pop()
        tree.end(_tag(name))

    def doctype(*_: object) -> NoReturn:
        raise DescriptionError(
            [f"{place()}: <!DOCTYPE> and entities are rejected; write out the values, or use xacro"]
        )

    def declare(prefix: str | None, uri: str | None) -> None:
        namespaces.add(uri or "")

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = tree.data
    parser.StartDoctypeDeclHandler = doctype
    parser.StartNamespaceDeclHandler = declare
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, LookupError, ValueError) as error:
        raise DescriptionError([_malformed(data, shown, error, opened)]) from None
    return Document(
        tree.close(), places, shown, folder, not namespaces.isdisjoint(XACRO_NAMESPACES)
    )


def _tag(name: str) -> str:
    """Convert expat's name of an element or attribute to ElementTree's."""
    if _SEPARATOR not in name:
        return name
    uri, local, *_ = name.split(_SEPARATOR)
    return f"{{{uri}}}{local}"


def _malformed(data: bytes, shown: str, error: Exception, opened: Sequence[tuple[str, int]]) -> str:
    """Return the message for malformed XML; ``opened`` are the elements around the fault."""
    if not isinstance(error, expat.ExpatError):
        return f"{shown}: its encoding cannot be read ({error}); save it as UTF-8"
    place = f"{shown}:{error.lineno}:{error.offset + 1}"
    try:
        data.decode("utf-8")
    except UnicodeDecodeError as bad:
        line = data.count(b"\n", 0, bad.start) + 1
        return f"{shown}:{line}: is not UTF-8 text (byte 0x{data[bad.start]:02x}); save it as UTF-8"
    reason = expat.ErrorString(error.code)
    if reason == "unbound prefix":
        remedy = f'for xacro: write <robot xmlns:xacro="{XACRO_NAMESPACES[0]}" ...>'
        remedy += f', for gz: xmlns:gz="{_GAZEBO_NAMESPACE}"'
        return f"{place}: the prefix of a name is not declared; {remedy}"
    if not data.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        return f"{place}: is not XML; URDF starts with <robot ...>"
    if opened and reason in ("mismatched tag", "no element found"):
        name, line = opened[-1]
        words = name.split(_SEPARATOR)  # namespace, name, prefix, or fewer
        reason += f": <{':'.join(reversed(words[1:] or words))}> of line {line} is not closed"
    if any(map(_is_dashed, _COMMENT.finditer(data))):
        reason += '; delete the "--" inside comments'
    return f"{place}: malformed XML: {reason}"


def to_text(root: ElementTree.Element) -> str:
    """Return indented XML text, headed by an XML declaration without an encoding.

    Short lines matter, because PyBullet splits lines of more than 8191 characters.
    """
    ElementTree.indent(root)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"
