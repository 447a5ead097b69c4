"""The same folders build with colcon, plainly and with links."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support import require_program

pytestmark = pytest.mark.slow

CHECKOUT = Path(__file__).resolve().parent.parent
PACKAGES = ("onebot_description", "onebot_control", "onebot_bringup", "mrm_description")
# What ``ros2 run`` finds: how it is run here, the exit code, and what it then prints.
EXECUTABLES = {
    "onebot_description/robot_state_publisher": (["nowhere.urdf"], 1, "nowhere.urdf"),
    "onebot_description/joint_state_publisher": (["nowhere.urdf"], 1, "nowhere.urdf"),
    "onebot_control/velocity_controller": (["nowhere.urdf"], 1, "nowhere.urdf"),
    "onebot_bringup/rerun_viewer": (["--ros-args", "-p", "viewer:=no"], 1, "viewer"),
    "onebot_bringup/steering_page": (["--ros-args", "-p", "port:=-1"], 1, "port"),
    "onebot_bringup/bag_recorder": ([], 1, "folder"),
    "onebot_bringup/onebot_bringup": (["--show-args"], 0, "mesh_enabled:=true"),
    "onebot_bringup/onebot": (["--help"], 0, "usage: onebot"),
    "mrm_description/mrm_bringup": (["--show-args"], 0, "joint_states:=true"),
}


@pytest.mark.parametrize("options", [(), ("--symlink-install",)])
def test_workspace_builds_and_runs(tmp_path, options):
    """Each package is built and found, and an executable starts as ``ros2 run`` would start it."""
    for program in ("cmake", "make"):
        require_program(program)
    source = tmp_path / "src/onebot"
    source.mkdir(parents=True)
    ignore = shutil.ignore_patterns("__pycache__", "*.so")
    for package in PACKAGES:
        shutil.copytree(CHECKOUT / package, source / package, ignore=ignore)
    shutil.copy(CHECKOUT / "pyproject.toml", source)
    environment = dict(os.environ)
    # colcon comes with the extra "test"; this environment need not be activated.
    environment["PATH"] = os.pathsep.join([f"{sys.prefix}/bin", environment["PATH"]])
    environment["AMENT_PREFIX_PATH"] = environment["CMAKE_PREFIX_PATH"] = sys.prefix
    built = subprocess.run(
        [f"{sys.prefix}/bin/colcon", "build", *options],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert built.returncode == 0, built.stdout + built.stderr
    assert "4 packages finished" in built.stdout + built.stderr
    assert "FutureWarning" not in built.stderr and "error" not in built.stderr.lower()
    # PYTHONPATH from setup.bash comes before this environment's own (editable) install.
    script = (
        "source install/setup.bash && "
        'python3 -c "import onebot_description.wire.tf_message as m; print(m.__file__)" && '
        'python3 -c "from onebot_description.description.packages import package_share as s;'
        "print(s('mrm_description'))\" && "
        "env -0 > environment"
    )
    ran = subprocess.run(
        ["bash", "-c", script], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    module, share = ran.stdout.split()
    assert str(tmp_path) in module, ran.stderr
    assert share == str(tmp_path / "install/mrm_description/share/mrm_description")
    _check_executables(tmp_path)
    _check_launch_files(tmp_path)


def _check_executables(workspace: Path) -> None:
    """Each one is where ``ros2 run`` looks, and starts as it would start it."""
    words = (workspace / "environment").read_text().split("\0")
    sourced = dict(word.split("=", 1) for word in words if word)
    found = [
        file
        for package in PACKAGES
        for file in (workspace / "install" / package / "lib" / package).iterdir()
        if os.access(file, os.X_OK)
    ]
    assert {f"{file.parent.name}/{file.name}" for file in found} == set(EXECUTABLES)
    for file in found:
        arguments, code, says = EXECUTABLES[f"{file.parent.name}/{file.name}"]
        ran = subprocess.run(
            [file, *arguments], cwd=workspace, env=sourced, capture_output=True, text=True
        )
        assert ran.returncode == code, ran.stderr
        assert says in ran.stdout + ran.stderr and "Traceback" not in ran.stderr


def _check_launch_files(workspace: Path) -> None:
    """Each one is once in the share folder of its package, where ``ros2 launch`` looks."""
    for file in CHECKOUT.glob("*/launch/*.launch.py"):
        package = file.parents[1].name
        (there,) = (workspace / "install" / package / "share" / package).rglob(file.name)
        assert there.read_text() == file.read_text()
