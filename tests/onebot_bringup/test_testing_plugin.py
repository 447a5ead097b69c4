"""The pytest plugin, in the tests of somebody else."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tests.orphans import marked
from tests.support import RunningProcess, run_to_end, wait_for
from tests.support_rendering import center, pixels, require_renderer

PLUGIN = "onebot_bringup.testing.plugin"
FIXTURES = """
import os
import pytest
import rclpy
from onebot_control import OneBotError
from rclpy.node import Node
from sensor_msgs.msg import JointState

def test_simulation(simulation):
    one, two = simulation(), simulation(seed=3)
    one.robot.drive(0.5)
    one.run(2.0)
    assert one.robot.pose.x > 0.5 > two.robot.pose.x == 0.0

def test_nodes_in_step(ros_simulation, ros_domain):
    ros = ros_simulation()
    received = []
    node = Node("listener")
    assert node.context.get_domain_id() == ros_domain == int(os.environ["ROS_DOMAIN_ID"])
    node.create_subscription(JointState, "joint_states", received.append, 100)
    ros.add(node)
    ros.simulation.run(1.0)
    assert len(received) == 100
    with pytest.raises(OneBotError, match="one simulation"):
        ros_simulation()

def test_nothing_is_left_of_the_test_before():
    assert not rclpy.ok() and "ROS_DOMAIN_ID" not in os.environ
"""
FAILS = """
def test_what_does_not_start(bringup):
    bringup("world:=maize")

def test_fails(simulation, ros_domain):
    world = simulation(world="maze", y=0.8, seed=5)
    world.robot.drive(0.5)
    world.run(8.0)
    assert False
"""
PASSES = """
def test_passes(simulation):
    simulation().run(0.1)
"""
WAITS = """
import time
def test_waits(bringup):
    bringup()
    print("up", flush=True)
    time.sleep(600)
"""


def words(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "pytest", "-p", PLUGIN, "-p", "no:cacheprovider", *arguments]


def run(folder: Path, code: str) -> str:
    """Run tests in a folder without any settings; what pytest prints."""
    (folder / "test_robot.py").write_text(code)
    environment = {name: value for name, value in os.environ.items() if name != "ROS_DOMAIN_ID"}
    done = run_to_end(words(), cwd=folder, env=environment)
    return done.stdout + done.stderr


def test_fixtures(tmp_path: Path) -> None:
    assert "3 passed" in run(tmp_path, FIXTURES)


@pytest.mark.slow
def test_a_failure_is_reported_and_shown(tmp_path: Path) -> None:
    """Its seed, time and domain, and what it did last as a recording and a picture.

    The robot is in the picture, although it has driven 2.7 m to a wall, which would hide it from
    the front. Of a test that passes nothing is written. What a bringup says of a mistake is the
    error; that one comes up, test_readme tests.
    """
    require_renderer()
    output = run(tmp_path, FAILS + PASSES)
    assert "2 failed, 1 passed" in output and 'no world "maize"' in output
    assert "seed 5, <Simulation at 8 s: robot at x 2." in output
    assert "ROS_DOMAIN_ID " in output
    files = {path.name: path for path in (tmp_path / "failed_tests").iterdir()}
    recorded, picture = "test_robot-test_fails.rrd", "test_robot-test_fails.png"
    assert files.keys() == {recorded, picture}, output
    assert {f"the end of it: {path}" for path in files.values()} <= {*output.splitlines()}
    image = pixels(files[picture])
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 100
    white = image.min(axis=2) > 200  # only OneBot's body, and small letters
    assert white.mean() > 0.02
    column, row = center(white)
    assert 0.2 < column < 0.6 and 0.3 < row < 0.7


@pytest.mark.slow
def test_nothing_is_left_of_a_run_that_is_killed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mark, temporary = f"killed-{time.monotonic_ns()}", tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("ONEBOT_TEST_KILLED", mark)
    monkeypatch.setenv("TMPDIR", str(temporary))
    (tmp_path / "test_robot.py").write_text(WAITS)
    with RunningProcess(words("-s"), tmp_path, check=False) as process:
        wait_for(lambda: "up\n" in process.output, "the bringup")
        assert marked(mark, "velocity_controller")
        assert [*temporary.glob("onebot-launch-*")]
        os.kill(process.process.pid, signal.SIGKILL)
        wait_for(lambda: not marked(mark), "the end of all that it started")
    assert not [*temporary.glob("onebot-test-*"), *temporary.glob("onebot-launch-*")]


def test_importing_it_takes_nothing() -> None:
    """A run of tests without robots pays nothing for the plugin."""
    code = (
        "import sys, os, pytest; before, environment = set(sys.modules), dict(os.environ);"
        f"import {PLUGIN};"
        "new = {name.partition('.')[0] for name in set(sys.modules) - before};"
        "assert not new & {'rclpy', 'rerun', 'pybullet', 'numpy', 'onebot_control'}, new;"
        "assert os.environ == environment, set(os.environ) - set(environment)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
