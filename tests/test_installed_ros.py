"""An installed ROS in place of its wheels: they lie outside of the environment, as one sourced."""

import ast
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import venv
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

import pytest

from onebot_description.ros.packages import ROS_PACKAGES, MissingRosError, PackageFinder
from tests.readme import run_until_up
from tests.support import run_to_end

CHECKOUT = Path(__file__).resolve().parent.parent
PACKAGES = ("onebot_description", "onebot_control", "onebot_bringup", "mrm_description")
SITE = Path(sysconfig.get_path("purelib"))
MRM = CHECKOUT / "mrm_description/urdf/mrm.xacro"
OF_ROS = ("PYTHONPATH", "AMENT_PREFIX_PATH", "LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")


def ros_files() -> set[Path]:
    """The files of the wheels of ROS, relative to the environment."""
    wheels = (each for each in metadata.distributions() if each.name.startswith("ros-"))
    files = {Path(os.path.normpath(file.locate())) for each in wheels for file in each.files or ()}
    return {file.relative_to(sys.prefix) for file in files if file.is_file()}


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The Python of an environment that has what the running one has, but for ROS."""
    folder = tmp_path_factory.mktemp("without_ros")
    venv.create(folder, with_pip=False)
    site = SITE.relative_to(sys.prefix)
    of_ros = {file.relative_to(site).parts[0] for file in ros_files() if site in file.parents}
    for entry in SITE.iterdir():
        if entry.name not in of_ros and not (folder / site / entry.name).exists():
            (folder / site / entry.name).symlink_to(entry)
    return folder / "bin/python"


@pytest.fixture(autouse=True)
def no_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in OF_ROS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PYTHONPATH", str(CHECKOUT))


@pytest.fixture(scope="module")
def ros(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A ROS of its own: what the wheels put into the environment."""
    folder = tmp_path_factory.mktemp("ros")
    for file in ros_files():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        try:
            os.link(Path(sys.prefix, file), folder / file)
        except OSError:  # another file system
            shutil.copy(Path(sys.prefix, file), folder / file)
    yield folder
    shutil.rmtree(folder)  # large


@pytest.fixture
def sourced(ros: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """That ROS, with the variables that its setup.bash would set."""
    site = ros / SITE.relative_to(sys.prefix)
    monkeypatch.setenv("PYTHONPATH", f"{CHECKOUT}:{site}")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(ros))
    libraries = [ros / "lib", *site.glob("ros_*.libs")]
    monkeypatch.setenv("LD_LIBRARY_PATH", os.pathsep.join(map(str, libraries)))
    return ros


@pytest.mark.slow
def test_a_robot_runs_on_an_installed_ros(python, sourced, tmp_path, ros_domain):
    """It comes up and is recorded, with the ROS outside; nothing else is different."""
    where = subprocess.run(
        [python, "-c", "import rclpy; print(rclpy.__file__)"], capture_output=True
    )
    assert where.stdout.decode().startswith(str(sourced)), where.stderr
    robot = "onebot_bringup.launch.onebot_bringup"
    command = f"{python} -m {robot} viewer:=none save:=run.rrd"
    code, output = run_until_up(command, tmp_path, timeout=180)
    assert code == 0 and "Traceback" not in output
    assert (tmp_path / "run.rrd").stat().st_size > 10_000


@pytest.mark.parametrize(
    "words",
    [
        "onebot_description.robot_state_publisher nowhere.urdf",
        "onebot_control.velocity_controller",
        "mrm_description.launch.mrm_bringup viewer:=none",
        "onebot_bringup.cli.main topic list",
    ],
)
def test_without_any_ros_one_line_says_what_to_source(python, words, tmp_path):
    """Neither a traceback nor an error of each node."""
    ran = run_to_end([python, "-m", *words.split()], cwd=tmp_path)
    assert ran.returncode == 1
    (line,) = ran.stderr.splitlines()
    assert line.startswith("error: no ROS 2 here")
    assert "source /opt/ros/jazzy/setup.bash" in line and "pip install" in line


def test_a_description_is_checked_without_any_ros(python, tmp_path):
    """What needs no ROS does without."""
    words = ["-m", "onebot_bringup.cli.main", "check", str(MRM)]
    ran = run_to_end([python, *words], cwd=tmp_path)
    assert ran.returncode == 0, ran.stderr
    assert "base_link" in ran.stdout


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("rclpy._rclpy_pybind11", "is built for another Python than this one"),
        (
            "nav_msgs",
            'lacks the package "nav_msgs": install it, for example with'
            " apt install ros-jazzy-nav-msgs",
        ),
    ],
)
def test_part_of_a_ros(name, says, monkeypatch):
    """What a ROS that is there lacks is named; any other module is left to its importer."""
    monkeypatch.setattr(sys, "excepthook", sys.excepthook)
    with pytest.raises(MissingRosError, match=re.escape(says)):
        PackageFinder.find_spec(name)
    PackageFinder.find_spec("tf2_msgs")


def test_all_that_is_imported_of_ros_is_explained():
    """A package of ROS that is imported, and is in no list, would give a traceback."""
    imported = set()
    for file in (path for package in PACKAGES for path in (CHECKOUT / package).rglob("*.py")):
        if "ros/packages/" in str(file):  # users' nodes import these, with ROS
            continue
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                imported.add(str(node.module).split(".")[0])
    of_ros = re.compile(r"rcl\w*|rosidl_\w+|\w+_(msgs|srvs|interfaces)|ament_\w+")
    assert {name for name in imported if of_ros.fullmatch(name)} == set(ROS_PACKAGES)
