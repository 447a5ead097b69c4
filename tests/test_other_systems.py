"""What needs no ROS also runs where there is none, and where Linux's own calls are missing.

macOS and Windows are not at hand. A Python on Linux that lacks what they lack runs the same scenes
to the same bits, and mypy checks that no other call is missing on Windows, which lacks all that
macOS lacks.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.other_system import SITECUSTOMIZE
from tests.scenes import SCENES
from tests.support import run_to_end

CHECKOUT = Path(__file__).resolve().parent.parent
# The modules that only nodes, the launcher and what watches running robots use: they need ROS.
NEEDS_ROS = (
    "onebot_bringup/launcher/",
    "onebot_bringup/testing/",
    "onebot_control/nodes/",
    "onebot_control/evaluation/on_ray",  # Ray on Linux
    "onebot_description/ros/domains",
    "onebot_description/description/bounded_process",  # it asks for each call; the scenes run it
    "onebot_bringup/cli/teleop",
    "onebot_bringup/cli/doctor",
    "onebot_bringup/bags/writer",
    "onebot_bringup/bags/bag_recorder",
    "onebot_description/ros/run_node",
    "onebot_description/ros/wake_detector",
    "onebot_description/ros/shared_memory",
    "onebot_description/ros/signals.py:1",  # StopSignals, from line 100 on
)


@pytest.fixture
def environment(tmp_path: Path) -> dict[str, str]:
    """The variables of a Python like that of Windows."""
    (tmp_path / "sitecustomize.py").write_text(SITECUSTOMIZE)
    return {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{CHECKOUT}"}


@pytest.mark.slow
def test_the_scenes_end_bit_identically(environment: dict[str, str]) -> None:
    command = [sys.executable, "tests/scenes.py"]
    here = run_to_end(command, cwd=CHECKOUT).stdout
    elsewhere = run_to_end(command, env=environment, cwd=CHECKOUT)
    assert elsewhere.returncode == 0, elsewhere.stderr
    assert len(here.splitlines()) == len(SCENES)
    assert elsewhere.stdout == here


@pytest.mark.slow
def test_commands_that_need_no_ros(environment: dict[str, str], tmp_path: Path) -> None:
    """A xacro file is checked and drawn."""
    model = str(CHECKOUT / "onebot_description/urdf/onebot.urdf.xacro")
    onebot = [sys.executable, "-m", "onebot_bringup.cli.main"]
    draw = ["snapshot", str(tmp_path / "onebot.png"), model, "--width=320", "--height=240"]
    for words in (["check", model], draw):
        done = run_to_end([*onebot, *words], env=environment, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
    assert (tmp_path / "onebot.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_nothing_else_is_missing_elsewhere(tmp_path: Path) -> None:
    """Mypy knows what each system's standard library has; other packages do not matter for that."""
    mypy = [sys.executable, "-m", "mypy", "--platform", "win32", "--cache-dir", str(tmp_path)]
    options = ["--no-site-packages", "--ignore-missing-imports"]
    done = subprocess.run([*mypy, *options], cwd=CHECKOUT, capture_output=True, text=True)
    missing = [line for line in done.stdout.splitlines() if "Module has no attribute" in line]
    assert [line for line in missing if not line.startswith(NEEDS_ROS)] == []
    assert missing, done.stdout + done.stderr
