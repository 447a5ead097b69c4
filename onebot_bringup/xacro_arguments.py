"""What a xacro file declares and includes, found without expanding it."""

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from onebot_bringup.launcher.arguments import Argument
from onebot_description.ament import package_share
from onebot_description.errors import OneBotError

_DEPTH = 10  # includes of includes; more is a circle
_USED = re.compile(r"\$\(\s*arg\s+([^\s)]+)\s*\)")


@dataclass(frozen=True)
class XacroArguments:
    """The arguments of a xacro file and of what it includes.

    Attributes:
        arguments: those declared, then those used without being declared.
        complete: whether all includes could be followed; if not, there may be more.
    """

    arguments: tuple[Argument, ...] = ()
    complete: bool = True


def xacro_arguments(source: str) -> XacroArguments:
    """Return the arguments of a xacro file, given as a path or as ``package://name/path``.

    A file that cannot be read, or an include whose name is only known when it is expanded, adds
    nothing: loading the description is what reports it.
    """
    declared: dict[str, Argument] = {}
    used: dict[str, Argument] = {}
    complete = True
    for file, root in _files(_path_of(source), _DEPTH):
        for element in root.iter():
            kind = _xacro_kind(element)
            if kind == "arg" and element.get("name"):
                argument = _argument(element, file)
                declared.setdefault(argument.name, argument)
            elif kind == "include" and _included(element.get("filename", ""), file) is None:
                complete = False
            for text in (element.text or "", *element.attrib.values()):
                for name in _USED.findall(text):
                    used.setdefault(name, Argument(name, "", f"used in {file.name}, required"))
    return XacroArguments(tuple({**used, **declared}.values()), complete)


def included_files(source: str) -> tuple[Path, ...]:
    """Return the file itself and those it includes, as far as they can be read now."""
    return tuple(dict.fromkeys(path for path, _ in _files(_path_of(source), _DEPTH)))


def _path_of(source: str) -> Path:
    """Return the file that is meant; one that does not exist if there is no such package."""
    if not source.startswith("package://"):
        return Path(source).expanduser()
    name, _, inner = source.removeprefix("package://").partition("/")
    try:
        return package_share(name) / inner
    except OneBotError:
        return Path(source)


def _files(file: Path, depth: int) -> Iterator[tuple[Path, ElementTree.Element]]:
    try:
        root = ElementTree.parse(file).getroot()
    except (OSError, ElementTree.ParseError, ValueError):
        return
    yield file, root
    for element in root.iter():
        if depth and _xacro_kind(element) == "include":
            included = _included(element.get("filename", ""), file)
            if included is not None:
                yield from _files(included, depth - 1)


def _xacro_kind(element: ElementTree.Element) -> str:
    """Return ``arg`` for ``<xacro:arg>``, and "" for an element that is not xacro's."""
    if not isinstance(element.tag, str):  # a comment
        return ""
    namespace, _, name = element.tag.rpartition("}")
    return name if "xacro" in namespace else ""


def _argument(element: ElementTree.Element, file: Path) -> Argument:
    default = element.get("default")
    required = "" if default is not None else ", required"
    return Argument(element.get("name", ""), default or "", f"declared in {file.name}{required}")


def _included(name: str, file: Path) -> Path | None:
    """Return the file an include of ``name`` in ``file`` means, if that is plain."""
    if name.startswith("$(find ") and ")" in name:
        package, _, rest = name.removeprefix("$(find ").partition(")")
        try:
            name = f"{package_share(package.strip())}{rest}"
        except OneBotError:
            return None
    return None if "$" in name or not name else file.parent / name
