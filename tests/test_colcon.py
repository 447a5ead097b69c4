"""The same folders build with colcon."""

import fnmatch
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from onebot_bringup.cli.run import EXECUTABLES
from tests.support import PATIENCE, require_program, run_to_end

pytestmark = pytest.mark.slow

CHECKOUT = Path(__file__).resolve().parent.parent
PACKAGES = ("onebot_description", "onebot_control", "onebot_bringup", "mrm_description")
# What ``ros2 run`` finds, as test_cli compares it with the command; of each package this one is
# run, and prints that.
RUN = {
    "onebot_description/robot_state_publisher": (["nowhere.urdf"], "nowhere.urdf"),
    "onebot_control/velocity_controller": (["nowhere.urdf"], "nowhere.urdf"),
    "onebot_bringup/onebot": (["--help"], "usage: onebot"),
    "mrm_description/mrm_bringup": (["--show-args"], "joint_states:=true"),
}
# All of the fast tests take minutes; it takes long to import the others, too.
SOME_TESTS = "test_mrm_model* test_speed_limiter* test_rates* test_poses*".split()
# The report of a Python that has what the workspace needs, but not this project itself.
DOCTOR = """
from importlib import metadata
known = metadata.distribution
def other(name):
    if name == "onebot-robots":
        raise metadata.PackageNotFoundError(name)
    return known(name)
metadata.distribution = other
from onebot_bringup.cli.doctor import run
run(["--timeout", "60"])
"""


def test_workspace_builds_and_runs(tmp_path):
    """Each package is built and found, and an executable starts as ``ros2 run`` would start it."""
    sourced = _built(tmp_path)
    report = _run(sourced, tmp_path, "python3", "-c", DOCTOR).stdout
    assert report.startswith("onebot 0.1.0, Python")
    assert re.search(r"^ok       dependencies: 1\d found$", report, re.MULTILINE), report
    _check_executables(tmp_path, sourced)
    _check_launch_files(tmp_path)
    _check_tests(tmp_path)


def _left_out(folder: str, names: list[str]) -> set[str]:
    """What the workspace need not have."""
    left = shutil.ignore_patterns("__pycache__", "*.so", "test_*.py")(folder, names)
    return left - {name for pattern in SOME_TESTS for name in fnmatch.filter(names, pattern)}


def _built(workspace: Path) -> dict[str, str]:
    """Build the packages in a workspace; the variables of a shell that has sourced it."""
    for program in ("cmake", "make"):
        require_program(program)
    source = workspace / "src/onebot"
    source.mkdir(parents=True)
    for folder in (*PACKAGES, "tests"):
        shutil.copytree(CHECKOUT / folder, source / folder, ignore=_left_out)
    shutil.copy(CHECKOUT / "pyproject.toml", source)
    built = _colcon(workspace, "build")
    assert built.returncode == 0, built.stdout + built.stderr
    assert "4 packages finished" in built.stdout + built.stderr
    assert "FutureWarning" not in built.stderr and "error" not in built.stderr.lower()
    # PYTHONPATH from setup.bash comes before this environment's own (editable) install.
    sourced = _sourced(workspace)
    code = (
        "import onebot_description.ros.wire.interfaces as m; print(m.__file__);"
        "from onebot_description.elements.packages import package_share as share;"
        "print(share('mrm_description'))"
    )
    module, share = _run(sourced, workspace, "python3", "-c", code).stdout.split()
    assert str(workspace) in module
    assert share == str(workspace / "install/mrm_description/share/mrm_description")
    return sourced


def _colcon(workspace: Path, *words: str) -> subprocess.CompletedProcess[str]:
    environment = dict(os.environ)
    # colcon comes with the extra "test"; this environment need not be activated.
    environment["PATH"] = os.pathsep.join([f"{sys.prefix}/bin", environment["PATH"]])
    environment["AMENT_PREFIX_PATH"] = environment["CMAKE_PREFIX_PATH"] = sys.prefix
    environment["PYTEST_ADDOPTS"] = "-n 0"
    return _run(environment, workspace, f"{sys.prefix}/bin/colcon", *words)


def _run(
    environment: dict[str, str], workspace: Path, *command: str | Path
) -> subprocess.CompletedProcess[str]:
    return run_to_end(command, cwd=workspace, env=environment, timeout=10 * PATIENCE)


def _sourced(workspace: Path) -> dict[str, str]:
    """The variables of a shell that has sourced the workspace."""
    environment = {**os.environ, "AMENT_PREFIX_PATH": sys.prefix}
    environment["PATH"] = os.pathsep.join([f"{sys.prefix}/bin", environment["PATH"]])
    shown = _run(environment, workspace, "bash", "-c", "source install/setup.bash && env -0")
    return dict(word.split("=", 1) for word in shown.stdout.split("\0") if word)


def _check_executables(workspace: Path, sourced: dict[str, str]) -> None:
    """Each one is where ``ros2 run`` looks, and these start as it would start them."""
    found = {
        f"{package}/{file.name}": file
        for package in PACKAGES
        for file in (workspace / "install" / package / "lib" / package).iterdir()
        if os.access(file, os.X_OK)
    }
    names = {f"{package}/{name}" for package, nodes in EXECUTABLES.items() for name in nodes}
    assert found.keys() == names | {"onebot_bringup/onebot"}
    for name, (arguments, says) in RUN.items():
        ran = _run(sourced, workspace, found[name], *arguments)
        assert says in ran.stdout + ran.stderr and "Traceback" not in ran.stderr


def _check_launch_files(workspace: Path) -> None:
    """Each one is once in the share folder of its package, where ``ros2 launch`` looks."""
    for file in CHECKOUT.glob("*/launch/*.launch.py"):
        package = file.parents[1].name
        (there,) = (workspace / "install" / package / "share" / package).rglob(file.name)
        assert there.read_text() == file.read_text()


def _check_tests(workspace: Path) -> None:
    """``colcon test`` runs those of each package on what is installed: an edit there fails them."""
    assert _colcon(workspace, "test", "--packages-select", *PACKAGES).returncode == 0
    good = _colcon(workspace, "test-result", "--all").stdout
    for package in PACKAGES:
        counts = rf"build/{package}/test_results/{package}/pytest.xml: (\d+) tests, 0 .*, 0 .*, 0 "
        assert int(re.findall(counts, good)[0]) > 1, good
    xacro = workspace / "install/mrm_description/share/mrm_description/urdf/mrm.xacro"
    before, after = (f'name="base_side" value="{side}"' for side in ("1.0", "2.0"))
    xacro.write_text(xacro.read_text().replace(before, after))
    assert _colcon(workspace, "test", "--packages-select", "mrm_description").returncode == 0
    bad = _colcon(workspace, "test-result", "--all")
    assert bad.returncode == 1
    assert re.search(r"mrm_description/pytest.xml: .* [1-9]\d* failure", bad.stdout), bad.stdout
