"""No circle of imports in the product: neither of files nor of rooms, whenever they are imported.

A room is a folder without those in it, or a module directly in a package such as
``onebot_control``. On each level below that, a folder with all those in it is a unit, and so is a
module beside it: packages on level 1, their folders on level 2, and so on. An import of a name that
an ``__init__`` exports lazily is one of the module that defines the name.
"""

import ast
import re
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from functools import cache, partial
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import pytest

from onebot_bringup.launch.nodes import NODES

ROOT = Path(__file__).parents[1]
PACKAGES = ("mrm_description", "onebot_bringup", "onebot_control", "onebot_description")


class Import(NamedTuple):
    """A module imports another one, at the top, in a function, or for its types only."""

    importer: str
    imported: str
    place: str = ""


@cache
def modules() -> dict[str, Path]:
    """The files of the product by their modules' names; examples are the users'."""
    files = (file for package in PACKAGES for file in sorted((ROOT / package).rglob("*.py")))
    found = {}
    for file in files:
        *folders, name = file.relative_to(ROOT).with_suffix("").parts
        if "examples" in folders:
            continue
        found[".".join(folders if name == "__init__" else [*folders, name])] = file
    return found


@cache
def lazy_exports() -> dict[str, str]:
    """The modules that define what packages export lazily, by full names of the exports."""
    return {
        f"{package}.{alias.name}": str(node.module)
        for package, file in modules().items()
        if is_lazy(package)
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


@cache
def is_lazy(module: str) -> bool:
    """Whether it is an ``__init__`` that exports its names lazily."""
    return "__getattr__ =" in modules()[module].read_text()


@cache
def imports() -> list[Import]:
    """Every import of one module of the product by another."""
    eager = {module: file for module, file in modules().items() if not is_lazy(module)}
    return [found for module, file in eager.items() for found in imports_of(module, file)]


def imports_of(module: str, file: Path) -> Iterator[Import]:
    files, shown = modules(), file.relative_to(ROOT)
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            whole = [f"{node.module}.{alias.name}" for alias in node.names]
            names = [name if name in files else str(node.module) for name in whole]
            names = [lazy_exports().get(*pair) for pair in zip(whole, names, strict=True)]
        else:
            continue
        for name in {*names} & files.keys():
            if not is_lazy(name):
                yield Import(module, name, f"{shown}:{node.lineno}")


@cache
def room(module: str) -> str:
    """The room of a module: its folder, or itself."""
    file = modules()[module].relative_to(ROOT)
    return file.parent.as_posix() if len(file.parts) > 2 else module


def at_level(level: int, module: str) -> str:
    """The folder of a module at a level below the product, or itself if it is not as deep."""
    return "/".join(modules()[module].relative_to(ROOT).parts[:level])


LEVELS = range(1, max(len(file.relative_to(ROOT).parts) for file in modules().values()))


def circle(found: Iterable[Import], unit: Callable[[str], str]) -> str:
    """The imports of one circle of units; "" if there is none."""
    graph, places = defaultdict[str, set[str]](set), defaultdict[tuple[str, str], list[str]](list)
    for importer, imported, place in found:
        ends = unit(importer), unit(imported)
        if ends[0] != ends[1]:
            graph[ends[0]].add(ends[1])
            places[ends].append(place)
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        steps = [(importer, imported) for imported, importer in pairwise(error.args[1])]
        return "\n".join(f"{a} imports {b}: {', '.join(places[a, b][:5])}" for a, b in steps)
    return ""


@pytest.mark.parametrize(
    "unit",
    [str, room, *(partial(at_level, level) for level in LEVELS)],
    ids=["files", "rooms", *(f"level {level}" for level in LEVELS)],
)
def test_there_is_no_circle(unit: Callable[[str], str]) -> None:
    """What two files, or two rooms, need of each other belongs into one of them, or a third."""
    found = circle(imports(), unit)
    assert not found, found


def test_a_circle_is_found() -> None:
    """Between rooms, although their files are in none."""
    found = [Import("drive.a", "nodes.b", "a.py:1"), Import("nodes.c", "drive.d", "c.py:2")]
    assert circle(found, str) == ""
    shown = circle(found, lambda module: module.partition(".")[0]).splitlines()
    assert sorted(shown) == ["drive imports nodes: a.py:1", "nodes imports drive: c.py:2"]


def test_units_of_imports() -> None:
    """Folders of each level, and the module behind a name that a package exports lazily."""
    deep = "onebot_bringup.viewer.core.stage"
    assert [at_level(level, deep) for level in (1, 2, 3)] == [
        "onebot_bringup",
        "onebot_bringup/viewer",
        room(deep),
    ]
    file = ROOT / "onebot_control" / "environment.py"
    imported = {found.imported for found in imports_of("onebot_control.environment", file)}
    assert "onebot_control.simulation" in imported
    assert lazy_exports()["onebot_control.Simulation"] == "onebot_control.simulation"


# What may use ROS: the nodes.
WITH_ROS = (
    *("onebot_bringup", "mrm_description", "onebot_description.ros", "onebot_control.nodes"),
    *(row.module for row in NODES),
)
ROS = re.compile(r"rclpy|rcl_interfaces|\w+_msgs|onebot_description\.ros|onebot_control\.nodes")


def test_pure_modules_import_nothing_of_ros() -> None:
    """At their top: Simulation.ros, and the messages of a missing ROS, import it when called."""
    found = []
    for module, file in modules().items():
        if is_lazy(module) or f"{module}.".startswith(tuple(f"{name}." for name in WITH_ROS)):
            continue
        for node in ast.parse(file.read_text()).body:
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [str(node.module)] if isinstance(node, ast.ImportFrom) else []
            found += [f"{module} imports {name}" for name in names if ROS.match(name)]
    assert len(modules()) > 200 and not found, found
