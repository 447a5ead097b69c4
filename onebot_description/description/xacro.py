"""Expands xacro files with limited time and memory, and finds the arguments that they declare."""

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from xml.etree.ElementTree import Element

from onebot_description.description.bounded_process import BoundExceeded, Bounds, run_bounded
from onebot_description.elements import xml
from onebot_description.elements.packages import Resources, resolve
from onebot_description.errors import DescriptionError, OneBotError, did_you_mean

_EXPAND = "onebot_description.description.expansion:expand_file"
# Large robots take a second and 100 MB.
_BOUNDS = Bounds()


def expand(
    path: Path, arguments: Mapping[str, str]
) -> tuple[xml.Document, tuple[Path, ...], tuple[str, ...]]:
    """Run xacro on a file with an absolute path, in its own process.

    Returns:
        The expanded document, the files read (``path`` first), and xacro's warnings.

    Raises:
        DescriptionError: xacro cannot expand it, takes too much time or memory, or the file has no
            argument of a given name.
    """
    name = xml.shown_path(path)
    request = {"path": str(path), "arguments": dict(arguments)}
    try:
        answer = run_bounded(_EXPAND, request, _BOUNDS)
    except BoundExceeded as met:
        text = f"{met.place or name}: expansion was stopped here: it takes more than {met}"
        raise DescriptionError([text]) from None
    except (OSError, RuntimeError) as error:  # such as too many processes, or a killed one
        raise DescriptionError([f"{name}: cannot be expanded: {error}"]) from None
    problems, declared = answer["problems"], answer["arguments"]
    for argument in arguments:
        if argument not in declared:
            hint = did_you_mean(argument, declared, "declared")
            problems.append(f'{name}: takes no argument "{argument}"{hint}')
    if problems:
        raise DescriptionError(problems)
    data = answer["text"].encode("utf-8", "replace")
    root = xml.parse(data, f"{name} (expanded)", encoding="utf-8").root
    places = dict(zip(root.iter(), answer["places"], strict=True))
    document = xml.Document(root, places, name, path.parent)
    return document, tuple(map(Path, answer["files"])), tuple(answer["warnings"])


# Arguments may be used without being declared.
_USED = re.compile(r"\$\(\s*arg\s+([^\s)]+)\s*\)|xacro\.arg\(\s*['\"]([^'\"]+)['\"]")


class XacroArgument(NamedTuple):
    """One ``<xacro:arg>``, or an argument that is used without one."""

    name: str
    default: str
    description: str  # names the file that declares or uses it


@dataclass(frozen=True)
class XacroArguments:
    """The arguments of a xacro file and of the files that it includes."""

    arguments: tuple[XacroArgument, ...] = ()  # declared ones, then those used without that
    complete: bool = True  # all includes could be followed; if not, there may be more


def xacro_arguments(source: str) -> XacroArguments:
    """Return the arguments of a xacro file, given as a path or as ``package://name/path``.

    A file that cannot be read, or an include whose name is only known when it is expanded, adds
    nothing; loading the description reports it.
    """
    files = list(_files(_path_of(source)))
    declared, used = arguments_in((path, root) for path, root, _ in files)
    complete = all(None not in included for _, _, included in files)
    return XacroArguments(tuple({**used, **declared}.values()), complete)


def arguments_in(
    files: Iterable[tuple[Path, Element]],
) -> tuple[dict[str, XacroArgument], dict[str, XacroArgument]]:
    """Return, by name, the arguments that files declare and the ones that they use."""
    declared: dict[str, XacroArgument] = {}
    used: dict[str, XacroArgument] = {}
    for file, root in files:
        for element in root.iter():
            name, default = element.get("name"), element.get("default")
            if name and _xacro_kind(element) == "arg":
                required = "" if default is not None else ", required"
                argument = XacroArgument(name, default or "", f"declared in {file.name}{required}")
                declared.setdefault(name, argument)
            for text in (element.text or "", element.tail or "", *element.attrib.values()):
                for name in map("".join, _USED.findall(text)):
                    used.setdefault(name, XacroArgument(name, "", f"used in {file.name}, required"))
    return declared, used


def included_files(source: str) -> tuple[Path, ...]:
    """Return the file and the files that it includes, even if they cannot be read now."""
    return tuple(path for path, _, _ in _files(_path_of(source).absolute()))


def _root_of(file: Path) -> Element:
    """Return the root of an XML file; an empty element if it cannot be read."""
    try:
        return xml.parse(xml.read_bytes(file), str(file)).root
    except OneBotError:
        return Element("unreadable")


def _path_of(source: str) -> Path:
    """Return the path of the file; it does not exist if there is no such package."""
    if not source.startswith("package://"):
        return Path(source).expanduser()
    try:
        return resolve(source, None)
    except OneBotError:
        return Path(source)


def _files(file: Path) -> Iterator[tuple[Path, Element, list[Path | None]]]:
    """Yield a file and those it includes, each once, with its root and its own includes."""
    waiting, names = [file], set()
    packages: dict[Path, Resources] = {}
    while waiting:
        file = waiting.pop(0)
        real = os.path.realpath(file)
        if real not in names:
            names.add(real)
            root = _root_of(file)
            included = _includes(file, root, packages)
            yield file, root, included
            waiting += filter(None, included)


def _includes(file: Path, root: Element, packages: dict[Path, Resources]) -> list[Path | None]:
    """Return the files that ``file`` includes; None for names only known when it is expanded."""
    elements = (element for element in root.iter() if _xacro_kind(element) == "include")
    names = [element.get("filename", "") for element in elements]
    folder = file.absolute().parent
    return [_included(name, file, packages.setdefault(folder, Resources(folder))) for name in names]


def _xacro_kind(element: Element) -> str:
    """Return ``arg`` for ``<xacro:arg>``, and "" for an element that is not xacro's."""
    namespace, _, name = element.tag.rpartition("}")
    return name if "xacro" in namespace else ""


def _included(name: str, file: Path, packages: Resources) -> Path | None:
    if name.startswith("$(find ") and ")" in name:
        package, _, subpath = name.removeprefix("$(find ").partition(")")
        try:
            name = f"{packages.package(package.strip())}{subpath}"
        except OneBotError:
            return None
    return None if "$" in name or not name else file.parent / name
