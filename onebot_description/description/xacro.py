"""Xacro files: expanded within bounds, and the arguments that they declare."""

import os
import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from onebot_description.description import xml
from onebot_description.description.bounded_process import BoundMet, Bounds, run_bounded
from onebot_description.description.packages import find_package, resolve
from onebot_description.errors import DescriptionError, OneBotError, did_you_mean

_EXPAND = "onebot_description.description.expansion:expand_file"
# Large robots take a second and 100 MB.
_BOUNDS = Bounds()


def expand(
    path: Path, arguments: Mapping[str, str]
) -> tuple[xml.Document, tuple[Path, ...], tuple[str, ...]]:
    """Run xacro on a file, in a process of its own.

    Args:
        path: the file, absolute.
        arguments: values for its ``<xacro:arg>``s.

    Returns:
        The expanded document, the files read (``path`` first), and xacro's warnings.

    Raises:
        DescriptionError: xacro cannot expand it, takes too much time or memory, or has no argument
            of a name given.
    """
    shown = xml.shown_path(path)
    request = {"path": str(path), "arguments": dict(arguments)}
    try:
        found = run_bounded(_EXPAND, request, _BOUNDS)
    except BoundMet as met:
        text = f"{met.place or shown}: expanding it was stopped here: it takes more than {met}"
        raise DescriptionError([text]) from None
    except (OSError, RuntimeError) as error:  # such as too many processes, or one that was killed
        raise DescriptionError([f"{shown}: cannot be expanded: {error}"]) from None
    problems = [*found["problems"], *_unknown_arguments(shown, arguments, found["arguments"])]
    if problems:
        raise DescriptionError(problems)
    return _to_document(found, path), tuple(map(Path, found["files"])), tuple(found["warnings"])


def _unknown_arguments(
    shown: str, arguments: Mapping[str, str], declared: list[str]
) -> Iterator[str]:
    for name in arguments:
        if name not in declared:
            hint = did_you_mean(name, declared, "declared")
            yield f'{shown}: takes no argument "{name}"{hint}'


def _to_document(found: Mapping[str, Any], path: Path) -> xml.Document:
    """Parse what xacro made, keeping the places of its elements."""
    shown = xml.shown_path(path)
    data = found["text"].encode("utf-8", "replace")
    scanned = xml.scan(data, f"{shown} (expanded)", "utf-8")
    fresh = xml.to_document(data, scanned, shown, path.parent, "utf-8")
    places = dict(zip(fresh.root.iter(), found["places"], strict=True))
    return xml.Document(fresh.root, places, shown, path.parent)


# Arguments that are used without being declared are arguments all the same.
_USED = re.compile(r"\$\(\s*arg\s+([^\s)]+)\s*\)|xacro\.arg\(\s*['\"]([^'\"]+)['\"]")


class XacroArgument(NamedTuple):
    """One ``<xacro:arg>``, or an argument that is used without one."""

    name: str
    default: str
    description: str  # which file declares or uses it


@dataclass(frozen=True)
class XacroArguments:
    """The arguments of a xacro file and of what it includes."""

    arguments: tuple[XacroArgument, ...] = ()  # declared ones, then those used without that
    complete: bool = True  # all includes could be followed; if not, there may be more


def xacro_arguments(source: str) -> XacroArguments:
    """Return the arguments of a xacro file, given as a path or as ``package://name/path``.

    A file that cannot be read, or an include whose name is only known when it is expanded, adds
    nothing: loading the description is what reports it.
    """
    declared: dict[str, XacroArgument] = {}
    used: dict[str, XacroArgument] = {}
    complete = True
    for file, root in _files(_path_of(source)):
        for element in root.iter():
            kind = _xacro_kind(element)
            if kind == "arg" and element.get("name"):
                argument = _argument(element, file)
                declared.setdefault(argument.name, argument)
            elif kind == "include" and _included(element.get("filename", ""), file) is None:
                complete = False
            for text in (element.text or "", *element.attrib.values()):
                for name in used_arguments(text):
                    used.setdefault(name, XacroArgument(name, "", f"used in {file.name}, required"))
    return XacroArguments(tuple({**used, **declared}.values()), complete)


def included_files(source: str) -> tuple[Path, ...]:
    """Return the file itself and those it includes, also those that cannot be read now."""
    return tuple(path for path, _ in _files(_path_of(source).absolute()))


def used_arguments(text: str) -> Iterator[str]:
    """Yield the arguments that ``text`` uses, as ``$(arg name)`` or ``xacro.arg('name')``."""
    for name, in_expression in _USED.findall(text):
        yield name or in_expression


def _path_of(source: str) -> Path:
    """Return the file that is meant; one that does not exist if there is no such package."""
    if not source.startswith("package://"):
        return Path(source).expanduser()
    try:
        return resolve(source, None)
    except OneBotError:
        return Path(source)


def _files(file: Path) -> Iterator[tuple[Path, ElementTree.Element]]:
    """Yield a file and those it includes, each once; the root of an unreadable one is empty."""
    waiting, found = [file], set()
    while waiting:
        file = waiting.pop(0)
        try:
            if (real := os.path.realpath(file)) in found:
                continue
            found.add(real)
            data = xml.read_bytes(file)
            xml.scan(data, str(file))
            root = ElementTree.fromstring(data)
        except (OneBotError, ElementTree.ParseError, ValueError):
            root = ElementTree.Element("unreadable")
        yield file, root
        for element in root.iter():
            if _xacro_kind(element) == "include":
                included = _included(element.get("filename", ""), file)
                if included is not None:
                    waiting.append(included)


def _xacro_kind(element: ElementTree.Element) -> str:
    """Return ``arg`` for ``<xacro:arg>``, and "" for an element that is not xacro's."""
    if not isinstance(element.tag, str):  # a comment
        return ""
    namespace, _, name = element.tag.rpartition("}")
    return name if "xacro" in namespace else ""


def _argument(element: ElementTree.Element, file: Path) -> XacroArgument:
    default = element.get("default")
    required = "" if default is not None else ", required"
    description = f"declared in {file.name}{required}"
    return XacroArgument(element.get("name", ""), default or "", description)


def _included(name: str, file: Path) -> Path | None:
    """Return the file an include of ``name`` in ``file`` means, if that is plain."""
    if name.startswith("$(find ") and ")" in name:
        package, _, rest = name.removeprefix("$(find ").partition(")")
        try:
            name = f"{find_package(package.strip(), file.absolute().parent)}{rest}"
        except OneBotError:
            return None
    return None if "$" in name or not name else file.parent / name
