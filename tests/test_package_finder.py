"""Packages that the wheels of ROS lack: found in any Python of the environment, and asked last."""

import os
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

from onebot_description.ros.packages import package_names
from onebot_description.ros.wire.interface_text import KINDS, own_interfaces
from tests.support import run_to_end, skip_for

SITE = Path(sysconfig.get_path("purelib"))
if not (SITE / "onebot_packages.pth").is_file():  # as in a workspace of colcon
    skip_for("the finder of packages: pip install")

GENUINE = "class Costmap:\n    genuine = True\n"
IS_GENUINE = "from nav2_msgs.msg import Costmap; print(hasattr(Costmap, 'genuine'))"


def run(code: str, *options: str, python: Path | str = sys.executable, **variables: str) -> str:
    """Return the output, or the last line of an error, of a Python elsewhere."""
    names = ("AMENT_PREFIX_PATH", "ROS_PACKAGE_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
    environment = {key: value for key, value in os.environ.items() if key not in names}
    done = run_to_end(
        [str(python), *options, "-c", code], cwd="/", env={**environment, **variables}
    )
    return done.stdout.strip() or done.stderr.strip().splitlines()[-1]


@pytest.fixture
def genuine(tmp_path: Path) -> Path:
    """A folder with a genuine nav2_msgs, which has messages only."""
    package = tmp_path / "genuine/nav2_msgs/msg"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text(GENUINE)
    (package.parent / "__init__.py").touch()
    return tmp_path / "genuine"


def test_it_imports_nothing_before_it_is_used() -> None:
    code = "import sys; print([name for name in sys.modules if 'onebot' in name])"
    assert run(code) == "[]"
    imported = "import sys\ntry: import nothing\nexcept ImportError: print(*sys.modules)"
    assert "onebot" not in run(imported)


def test_it_is_asked_while_its_own_needs_are_imported(tmp_path: Path) -> None:
    """As by ``copy``, which tries ``org.python``: xml.etree needs it, and site may have neither."""
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/package.xml").write_text("<package><name>mine</name></package>")
    code = f"""
import sys; sys.path.append({str(SITE)!r})
import onebot_description.ros.packages as packages; packages.install()
import copy; print(copy.deepcopy([1]), "xml.etree" in sys.modules)
"""
    checkout = Path(__file__).parents[1]
    variables = {"ROS_PACKAGE_PATH": str(tmp_path), "PYTHONPATH": str(checkout)}
    assert run(code, "-S", **variables) == "[1] False"


def test_each_package_is_found() -> None:
    """By its own name, with each of its interfaces."""
    names = [name for kind in KINDS for name in own_interfaces(kind)]
    pairs = [(name.replace("/", ".").rpartition(".")[0], name.rpartition("/")[2]) for name in names]
    code = f"""
from importlib import import_module
for package in {package_names()!r}: assert import_module(package).__name__ == package
from nav2_msgs import action, msg, srv
for module, name in {pairs!r}: assert getattr(import_module(module), name).__name__ == name
print("found", {len(pairs)})
"""
    assert run(code) == f"found {len(pairs)}"


def test_a_genuine_package_before_it(genuine: Path) -> None:
    assert run(IS_GENUINE) == "False"
    assert run(IS_GENUINE, PYTHONPATH=str(genuine)) == "True"


def test_a_genuine_package_is_not_completed(genuine: Path) -> None:
    """By parts that it lacks, such as those of another version."""
    problem = run("import nav2_msgs.action", PYTHONPATH=str(genuine))
    assert problem == "ModuleNotFoundError: No module named 'nav2_msgs.action'"
    problem = run("from nav2_msgs.msg import SpeedLimit", PYTHONPATH=str(genuine))
    assert problem.startswith("ImportError: cannot import name 'SpeedLimit'")


@pytest.mark.parametrize("used", [False, True])
def test_a_genuine_package_after_it(genuine: Path, used: bool) -> None:
    """Of a finder that is installed later, as by editable installations."""
    code = f"""
import sys
from importlib.machinery import PathFinder
class Later:
    def find_spec(name, path, target):
        return PathFinder.find_spec(name, [{str(genuine)!r}])
if {used}: import control_msgs.msg
sys.meta_path.append(Later)
"""
    assert run(code + IS_GENUINE) == "True"


@pytest.fixture
def seeing(tmp_path: Path) -> Path:
    """The Python of an environment that has what this one has, and sees other site-packages."""
    venv.create(tmp_path / "seeing", with_pip=False, system_site_packages=True)
    site = tmp_path / "seeing" / SITE.relative_to(sys.prefix)
    for entry in SITE.iterdir():
        if not (site / entry.name).exists():
            (site / entry.name).symlink_to(entry)
    return tmp_path / "seeing/bin/python"


def test_a_genuine_package_in_the_system(seeing: Path, genuine: Path, tmp_path: Path) -> None:
    """In site-packages that the environment sees after its own."""
    # The user's come after the environment's, as the system's do, but need no root.
    user = tmp_path / "user" / SITE.relative_to(sys.prefix)
    user.parent.mkdir(parents=True)
    user.symlink_to(genuine)
    assert run(IS_GENUINE, python=seeing) == "False"
    assert run(IS_GENUINE, python=seeing, PYTHONUSERBASE=str(tmp_path / "user")) == "True"


def test_another_ros_switches_it_off(tmp_path: Path) -> None:
    """Whose packages are complete, or to be installed there; a workspace on the wheels does not."""
    index = tmp_path / "share/ament_index/resource_index/packages"
    index.mkdir(parents=True)
    (index / "my_robot").touch()
    prefixes = os.pathsep.join([str(tmp_path), sys.prefix])
    assert run(IS_GENUINE, AMENT_PREFIX_PATH=prefixes) == "False"
    (index / "rclpy").touch()
    problem = run(IS_GENUINE, AMENT_PREFIX_PATH=prefixes)
    assert problem == "ModuleNotFoundError: No module named 'nav2_msgs'"


def test_where_packages_come_from(genuine: Path) -> None:
    """As ``onebot doctor`` says."""
    code = "from onebot_bringup.cli.doctor import _packages; print(*_packages())"
    line = run(code, PYTHONPATH=str(genuine))
    assert f"nav2_msgs from {genuine}" in line and line.startswith("ok ")
    assert "control_msgs, " in line.partition(" from ")[0]
