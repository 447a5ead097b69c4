"""Writes stubs (PEP 561) of packages of interfaces, for editors and type checkers.

Their classes are made at run time, where editors cannot see them. The build of the wheel writes
``package-stubs`` for each package here, ``onebot interface add`` for a user's own. This module
imports nothing from ROS, and only what the build has.
"""

import itertools
import re
from collections.abc import Iterator
from pathlib import Path

_TYPES = {"bool": "bool", "byte": "bytes", "char": "int", "string": "str", "wstring": "str"}
_FIELD = re.compile(
    r"(?P<type>[\w/]+)(?:<=\d+)?(?P<array>\[(?:<=)?\d*\])?\s+(?P<name>\w+)\s*(?P<is>=)?"
)
_PARTS = {"msg": ("",), "srv": ("Request", "Response"), "action": ("Goal", "Result", "Feedback")}
_HEAD = """\
import builtins
from collections.abc import Iterable, MutableSequence
from typing import Any, ClassVar
"""
_COMMON = """\
{0}SLOT_TYPES: ClassVar[tuple[Any, ...]]
{0}@classmethod
{0}def get_fields_and_field_types(cls) -> builtins.dict[builtins.str, builtins.str]: ...
"""
_PROPERTY = """\
{0}@builtins.property
{0}def {1}(self) -> MutableSequence[{2}]: ...
{0}@{1}.setter
{0}def {1}(self, value: Iterable[{2}]) -> None: ...
"""


def write_stubs(package: str, folder: Path, target: Path) -> Path | None:
    """Write the stubs of a package; return their folder, or None if it has no interfaces.

    Args:
        package: its name.
        folder: its folder, with msg/, srv/ or action/.
        target: the folder to put ``package-stubs`` in.
    """
    stubs = target / f"{package}-stubs"
    for kind in _PARTS:
        if files := sorted((folder / kind).glob(f"*.{kind}")):
            texts = {file.stem: file.read_text(encoding="utf-8") for file in files}
            (stubs / kind).mkdir(parents=True, exist_ok=True)
            (stubs / kind / "__init__.pyi").write_text(_module(package, kind, texts))
            (stubs / "__init__.pyi").touch()
    return stubs if stubs.is_dir() else None


def _module(package: str, kind: str, texts: dict[str, str]) -> str:
    classes = (_interface(package, kind, name, text) for name, text in texts.items())
    body = "".join(itertools.chain.from_iterable(classes))
    imported = sorted(set(re.findall(r"\b(\w+)\.msg\.\w", body)))
    return "\n".join([_HEAD + "".join(f"import {name}.msg\n" for name in imported), body])


def _interface(package: str, kind: str, name: str, text: str) -> Iterator[str]:
    sections = re.split(r"^---[ \t]*$", text, flags=re.MULTILINE)
    if kind == "msg":
        yield from _message(package, name, text, "")
        return
    yield f"class {name}:\n"
    for part, section in zip(_PARTS[kind], sections, strict=False):
        yield from _message(package, part, section, "    ")
    yield "    Impl: ClassVar[Any]\n" if kind == "action" else "    Event: ClassVar[Any]\n"
    if kind == "srv":
        yield "".join(f"{name}_{part} = {name}.{part}\n" for part in _PARTS[kind])


def _message(package: str, name: str, text: str, indent: str) -> Iterator[str]:
    yield f"{indent}class {name}:\n"
    inner, arguments = f"{indent}    ", []
    for line in text.splitlines():
        field = _FIELD.match(line.strip())
        if not field:
            continue
        kind = _type(package, field["type"])
        if field["is"]:
            yield f"{inner}{field['name']}: ClassVar[{kind}]\n"
            continue
        accepted = f"Iterable[{kind}]" if field["array"] else kind
        arguments.append(f"{field['name']}: {accepted} = ...")
        if field["array"]:
            yield _PROPERTY.format(inner, field["name"], kind)
        else:
            yield f"{inner}{field['name']}: {kind}\n"
    keywords = ", ".join(["self", "*", *arguments, "check_fields: builtins.bool = ..."])
    yield f"{inner}def __init__({keywords}) -> None: ...\n{_COMMON.format(inner)}"


def _type(package: str, name: str) -> str:
    if name in _TYPES or name.startswith(("int", "uint", "float")):
        return "builtins." + _TYPES.get(name, "float" if name.startswith("float") else "int")
    home, _, short = name.rpartition("/")
    return f"{home.partition('/')[0] or package}.msg.{short}"
