"""One tree that pip installs and colcon builds, registered where ROS tools look."""

import importlib
import os
import re
import shutil
import sys
from importlib import metadata
from pathlib import Path
from xml.etree import ElementTree
from zipfile import ZipFile

import pytest
from packaging.requirements import Requirement

from tests.environments import (
    CHECKOUT,
    build,
    copy_of_checkout,
    environment_without_ros_variables,
    fresh_environment,
    install,
)
from tests.support import run_to_end

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

# The architecture's table: what each folder may import.
MAY_IMPORT = {
    "onebot_description": set(),
    "onebot_control": {"onebot_description"},
    "onebot_bringup": {"onebot_description", "onebot_control"},
    "mrm_description": {"onebot_bringup", "onebot_description"},
}
DATA = ("urdf", "worlds", "meshes", "config", "notebooks", "examples")


def _manifest(package: str) -> ElementTree.Element:
    return ElementTree.parse(CHECKOUT / package / "package.xml").getroot()


def test_top_level_folders_are_the_fixed_ones():
    """No package folder stands beside those the project has."""
    tracked = run_to_end(["git", "ls-files"], cwd=CHECKOUT, check=True).stdout.split()
    folders = {path.split("/")[0] for path in tracked if "/" in path}
    assert folders <= {*MAY_IMPORT, "tests", ".ci", ".github"}


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_packages_depend_one_way(package):
    """On what the architecture allows; test_metadata compares package.xml with the imports."""
    depends = {element.text for element in _manifest(package).iter("exec_depend")}
    assert depends & set(MAY_IMPORT) <= MAY_IMPORT[package]


def test_every_data_folder_is_in_the_table():
    """A data folder forgotten in pyproject.toml would go unnoticed in a checkout."""
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())
    table = project["tool"]["hatch"]["build"]["targets"]["wheel"]["shared-data"]
    for package in MAY_IMPORT:
        cmake = (CHECKOUT / package / "CMakeLists.txt").read_text()
        for name in DATA:
            if (CHECKOUT / package / name).is_dir():
                assert table[f"{package}/{name}"] == f"share/{package}/{name}"
                assert name in cmake.partition("DIRECTORY")[2].partition("DESTINATION")[0]
        for file in (CHECKOUT / package).glob("launch/*.launch.py"):
            name = f"launch/{file.name}"
            assert table[f"{package}/{name}"] == f"share/{package}/{name}"
            assert f"install(FILES {name} DESTINATION share/${{PROJECT_NAME}}/launch)" in cmake
        assert table[f"{package}/package.xml"] == f"share/{package}/package.xml"
        marker = f"share/ament_index/resource_index/packages/{package}"
        assert table[f"{package}/py.typed"] == marker


@pytest.mark.parametrize(
    ("system", "machine", "wheels"),
    [
        ("linux", "x86_64", 2),
        ("linux", "aarch64", 0),
        ("darwin", "arm64", 0),
        ("win32", "AMD64", 0),
    ],
)
def test_wheels_of_ros_are_asked_for_where_they_exist(system, machine, wheels):
    """Elsewhere pip installs the rest, and ROS is an installed one."""
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]
    required = map(Requirement, project["dependencies"])
    platform = {"sys_platform": system, "platform_machine": machine}
    asked = [each.name for each in required if not each.marker or each.marker.evaluate(platform)]
    assert len([name for name in asked if name.startswith("ros-")]) == wheels
    assert {"xacro", "rerun-sdk"} <= set(asked)
    assert ("embreex" in asked) == (machine in ("x86_64", "AMD64") or system == "darwin")


@pytest.mark.parametrize(
    ("system", "machine", "python", "name"),
    [
        ("linux", "x86_64", "3.10", "pybullet"),
        ("linux", "x86_64", "3.11", "pybullet"),
        ("linux", "x86_64", "3.12", "pybullet-arm64"),
        ("linux", "x86_64", "3.13", "pybullet-arm64"),
        ("linux", "aarch64", "3.12", "pybullet"),
        ("darwin", "arm64", "3.10", "pybullet-arm64"),
        ("win32", "AMD64", "3.11", "pybullet-arm64"),
    ],
)
def test_one_pybullet_is_required_everywhere(system, machine, python, name):
    """Where pybullet has a wheel, or neither has, itself; its fork elsewhere."""
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]
    place = {"sys_platform": system, "platform_machine": machine, "python_version": python}
    required = map(Requirement, project["dependencies"])
    found = [each.name for each in required if each.name.startswith("pybullet")
             and (not each.marker or each.marker.evaluate(place))]  # fmt: skip
    assert found == [name]


def _say(python: Path, code: str, cwd: Path) -> str:
    environment = environment_without_ros_variables()
    # The wheels' start-up hook is not run for a path that a .pth adds: name the libraries instead.
    environment["LD_LIBRARY_PATH"] = os.environ.get("LD_LIBRARY_PATH", "")
    environment["_ROS_WHEELS_BOOTSTRAP_COMPLETE"] = "1"
    done = run_to_end([str(python), "-c", code], env=environment, cwd=cwd)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


WHERE = (
    "from onebot_description.elements.packages import package_share;"
    "from onebot_description.ros.wire.interfaces import TFMessage;"
    "import os, xacro;"
    "share = package_share('mrm_description');"
    "from ament_index_python import get_package_share_directory as find;"
    "assert os.path.realpath(find('mrm_description')) == str(share);"
    "from onebot_description.description import load_description;"
    "print(share, load_description(share / 'urdf/mrm.xacro').robot_name)"
)


def test_extras_in_messages_are_the_projects():
    """The distribution that messages have people install, and none that is another project's."""
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text())["project"]
    files = [path for name in MAY_IMPORT for path in (CHECKOUT / name).rglob("*.py")]
    named = re.findall(r"[\w-]*onebot[\w-]*\[\w+\]", "".join(path.read_text() for path in files))
    extras = {f"onebot-robots[{extra}]" for extra in project["optional-dependencies"]}
    assert project["name"] == "onebot-robots" and named and {*named} <= extras


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_each_package_has_the_installed_version(package):
    module = importlib.import_module(package)
    assert module.__version__ == metadata.version("onebot-robots")
    with pytest.raises(AttributeError, match="no_such"):
        _ = module.no_such


@pytest.mark.parametrize(
    ("words", "program"),
    [
        ("-m onebot_bringup --version", "onebot_bringup"),
        ("-m onebot_bringup.launch.onebot_bringup viewer:=none -V", "onebot_bringup"),
        ("-m mrm_description.launch.mrm_bringup --version", "mrm_bringup"),
        ("-m onebot_bringup.cli.main --version", "onebot"),
    ],
)
def test_each_command_prints_the_installed_version(words, program):
    """They start nothing."""
    done = run_to_end([sys.executable, *words.split()])
    version = metadata.version("onebot-robots")
    assert (done.returncode, done.stdout, done.stderr) == (0, f"{program} {version}\n", "")


@pytest.mark.slow
def test_source_distribution_gives_the_same_wheel(tmp_path):
    """What an index serves builds without the checkout, and registers the packages.

    $(find pkg) and ament_index work with no variable set by the user.
    """
    checkout = copy_of_checkout(tmp_path)
    there = build(checkout, "wheel", tmp_path / "there")
    shutil.unpack_archive(build(checkout, "sdist", tmp_path / "sdist"), tmp_path / "unpacked")
    shutil.rmtree(checkout)
    (source,) = (tmp_path / "unpacked").iterdir()
    for name in ("CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "Dockerfile"):
        assert (source / name).is_file(), name
    wheel = build(source, "wheel", tmp_path / "wheel")
    assert wheel.name == there.name
    assert ZipFile(wheel).namelist() == ZipFile(there).namelist()
    python = fresh_environment(tmp_path)
    install(python, str(wheel))
    share = tmp_path / "venv/share/mrm_description"
    assert _say(python, WHERE, tmp_path) == f"{share} mrm"
    (file,) = (tmp_path / "venv").rglob("mrm_bringup.launch.py")  # where ros2 launch looks
    assert file == share / "launch/mrm_bringup.launch.py"
    assert (tmp_path / "venv/bin/mrm_bringup").is_file()
    version = run_to_end([tmp_path / "venv/bin/onebot", "--version"])
    assert version.stdout.split() == ["onebot", "0.1.0"]


@pytest.mark.slow
def test_editable_install_sees_an_edited_xacro_at_once(tmp_path):
    """The checkout's own files come first, not the copies made when it was installed."""
    python = fresh_environment(tmp_path)
    checkout = copy_of_checkout(tmp_path)
    install(python, "-e", str(checkout))
    xacro = checkout / "mrm_description/urdf/mrm.xacro"
    xacro.write_text(xacro.read_text().replace('name="mrm"', 'name="edited"'))
    share, name = _say(python, WHERE, tmp_path).rsplit(" ", 1)
    assert name == "edited"
    assert Path(share).resolve() == checkout / "mrm_description"
