"""What the manifests declare: what is imported, who made it, under which name and version."""

import ast
import re
import sys
from collections.abc import Iterable
from functools import cache
from importlib import metadata
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

CHECKOUT = Path(__file__).resolve().parent.parent
PACKAGES = ("onebot_description", "onebot_control", "onebot_bringup", "mrm_description")
PROJECT = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]
FOR_TESTS = ("test", "mutation")  # extras
KEYS = yaml.safe_load((CHECKOUT / "tests/rosdep_keys.yaml").read_text())
# Packages of ROS that no wheel has; the wheel of any other is called ros-NAME.
ROOM = CHECKOUT / "onebot_description/ros/packages"
WITHOUT_WHEEL = {"launch", *(folder.name for folder in ROOM.iterdir() if folder.is_dir())}
TYPE = re.compile(r'"(\w+)/(?:msg|srv|action)/')
INSTALLED = {canonicalize_name(each.name) for each in metadata.distributions()}
# What pip calls what has a module; several distributions may share a folder.
DISTRIBUTIONS = metadata.packages_distributions()


@cache
def _imports(file: Path) -> frozenset[str]:
    """The modules that a file imports, at its head or in a function."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(file.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: relative import"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return frozenset(found)


def _file(module: str) -> Path | None:
    """The file of the checkout that has this module, or that of which it is a member."""
    path = CHECKOUT.joinpath(*module.split("."))
    files = (path.with_suffix(".py"), path.parent.with_suffix(".py"))
    return next((file for file in files if file.is_file()), None)


def _third_party(files: Iterable[Path]) -> set[str]:
    """What these files, and the modules of ``tests`` that they use, import from elsewhere."""
    found: set[str] = set()
    waiting, seen = list(files), set[Path]()
    while waiting:
        file = waiting.pop()
        seen.add(file)
        for module in _imports(file):
            top = module.partition(".")[0]
            if top == "tests":
                used = _file(module)
                waiting += [used] if used and used not in seen else []
            elif top not in sys.stdlib_module_names and not _is_own(top):
                found.add(top)
    return found


def _is_own(module: str) -> bool:
    """Whether it is a package for users' nodes, which finds itself where none is installed."""
    return (CHECKOUT / "onebot_description/ros/packages" / module / "__init__.py").exists()


def _of_package(package: str) -> set[str]:
    return _third_party((CHECKOUT / package).rglob("*.py"))


def _of_tests(package: str) -> set[str]:
    folder = CHECKOUT / "tests" / package
    return _third_party([*folder.rglob("*.py"), CHECKOUT / "tests/conftest.py"])


def _named_packages() -> set[str]:
    """The ROS packages whose types the product names in its code, as `package/msg/Type`."""
    files = (file for package in PACKAGES for file in (CHECKOUT / package).rglob("*.py"))
    return {name for file in files for name in TYPE.findall(file.read_text())}


def _is_of_ros(module: str) -> bool:
    return module in WITHOUT_WHEEL or canonicalize_name(f"ros-{module}") in INSTALLED


def _keys(modules: set[str]) -> set[str]:
    others = {each for each in modules if not _is_of_ros(each) and each not in PACKAGES}
    assert others <= KEYS.keys(), "look for its key in rosdistro, and add it to rosdep_keys.yaml"
    return (modules - others) | {KEYS[each] for each in others if KEYS[each]}


def _manifest(package: str) -> ElementTree.Element:
    return ElementTree.parse(CHECKOUT / package / "package.xml").getroot()


def _texts(package: str, tag: str) -> list[str]:
    return [str(element.text) for element in _manifest(package).iter(tag)]


@pytest.mark.parametrize("package", PACKAGES)
def test_manifest_names_what_the_package_imports(package):
    """Under the keys that rosdep knows; a package with xacro files needs xacro, too."""
    needed = _keys(_of_package(package) - {package})
    if any((CHECKOUT / package).rglob("*.xacro")):
        needed.add("xacro")
    if package == "onebot_description":  # makes their types where they are not installed
        needed |= _named_packages() & WITHOUT_WHEEL
    named = _texts(package, "exec_depend")
    assert sorted(named) == sorted(needed)


@pytest.mark.parametrize("package", PACKAGES)
def test_manifest_names_what_the_tests_import(package):
    """But the packages that depend on this one: colcon refuses a circle."""
    needed = _keys(_of_tests(package) - set(PACKAGES)) - set(_texts(package, "exec_depend"))
    assert sorted(_texts(package, "test_depend")) == sorted(needed)


def _declared(extras: Iterable[str]) -> set[str]:
    """The distributions that pip installs with these extras, but for ROS."""
    optional = PROJECT["optional-dependencies"]
    lines = [*PROJECT["dependencies"], *(line for extra in extras for line in optional[extra])]
    return {canonicalize_name(Requirement(line).name) for line in lines}


def _undeclared(modules: set[str], declared: set[str]) -> set[str]:
    """The modules of distributions that are neither declared nor wheels of ROS."""
    others = {each for each in modules if not _is_of_ros(each) and each not in PACKAGES}
    names = {each: map(canonicalize_name, DISTRIBUTIONS.get(each, [each])) for each in others}
    return {each for each in others if declared.isdisjoint(names[each])}


def test_pip_installs_what_is_imported():
    """Each distribution by its own name, not because another one happens to need it."""
    extras = set(PROJECT["optional-dependencies"]) - set(FOR_TESTS)
    modules = set().union(*map(_of_package, PACKAGES)) - {"pytest"}  # which imports the plugin
    assert not _undeclared(modules, _declared(extras))


def test_pip_installs_what_the_tests_import():
    """With the extras for tests."""
    modules = _third_party((CHECKOUT / "tests").rglob("*.py")) - {"readme"}
    if sys.version_info >= (3, 11):
        modules.discard("tomli")
    assert not _undeclared(modules, _declared(FOR_TESTS))


def _people(package: str, tag: str) -> list[tuple[str | None, str | None]]:
    return [(each.text, each.get("email")) for each in _manifest(package).iter(tag)]


def test_manifests_agree():
    """Each names the same authors, address, version and licence."""
    authors = [(each["name"], each["email"]) for each in PROJECT["authors"]]
    urls = {kind.lower(): address for kind, address in PROJECT["urls"].items()}
    for package in PACKAGES:
        assert _people(package, "author") == authors
        assert {each.get("type"): each.text for each in _manifest(package).iter("url")} == urls
        assert _texts(package, "version") == [PROJECT["version"]]
        assert _texts(package, "license") == [PROJECT["license"]]
    citation = yaml.safe_load((CHECKOUT / "CITATION.cff").read_text())
    assert [(each["name"], each["email"]) for each in citation["authors"]] == authors
    assert citation["url"] == urls["website"]
    assert citation["version"] == PROJECT["version"]
    assert citation["license"] == PROJECT["license"]
    assert f"(c) 2026, {authors[0][0]}" in (CHECKOUT / "LICENSE").read_text()
