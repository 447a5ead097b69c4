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
        "install/onebot_description/lib/onebot_description/robot_state_publisher nowhere.urdf"
    )
    ran = subprocess.run(
        ["bash", "-c", script], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    module, share = ran.stdout.split()
    assert str(tmp_path) in module, ran.stderr
    assert share == str(tmp_path / "install/mrm_description/share/mrm_description")
    assert ran.returncode == 1
    assert "nowhere.urdf" in ran.stderr and "Traceback" not in ran.stderr
