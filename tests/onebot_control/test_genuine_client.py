"""A client with control_msgs as everyone else has it, built here by ROS's own generators.

The types that this project makes of definitions are tested with themselves everywhere else; here
they meet types of another origin, with which they share neither code nor memory.
"""

import os
import subprocess
import sys
import sysconfig
from importlib.machinery import PathFinder
from pathlib import Path

import pytest

from onebot_description.ros.wire.interfaces import TFMessage
from tests.onebot_control.arm_support import CONTROL, MODULE, ROBOT
from tests.onebot_description.test_interfaces import (
    HASHES,
    classes_of,
    described,
    generated_description,
)
from tests.orphans import marked
from tests.ros_support import NodeProcess, Peer
from tests.support import require, require_program, skip_for, wait_for

PACKAGE = "control_msgs"
OLDER_GRIPPER = """\
older_gripper:
  ros__parameters: {type: position_controllers/GripperActionController, joint: pan}
"""
CHECKOUT = Path(__file__).resolve().parents[2]


def run(*command: str, **variables: str) -> str:
    """The output of a Python process, which ends well."""
    done = subprocess.run(
        [sys.executable, *command],
        cwd=CHECKOUT,
        env={**os.environ, **variables},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    assert done.returncode == 0, done.stdout
    return done.stdout


def before(folder: Path, variable: str) -> str:
    """A path variable of the environment with a folder before what it has."""
    return os.pathsep.join(filter(None, [str(folder), os.environ.get(variable)]))


def build(folder: Path, package: str) -> None:
    """Build a package in a new folder, by compilers that have to be there."""
    for compiler, name in (("cc", "gcc"), ("c++", "g++")):
        require_program(compiler, name)
    header = Path(sysconfig.get_path("include"), "Python.h")
    require(header.is_file(), str(header), "python3-dev")
    run("-m", "tests.onebot_control.genuine_control_msgs", str(folder), *types_of(package))


def types_of(package: str) -> list[str]:
    """The types of a package that the nodes here use: to build all takes minutes."""
    return [name for name in HASHES if name.startswith(f"{package}/")]


@pytest.mark.slow
def test_a_robot_uses_the_tf2_msgs_of_a_sourced_ros(
    peer: Peer, ros_domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And our own type is the same on DDS."""
    build(tmp_path / "ros", "tf2_msgs")
    monkeypatch.setenv("PYTHONPATH", before(tmp_path / "ros", "PYTHONPATH"))
    monkeypatch.setenv("LD_LIBRARY_PATH", before(tmp_path / "ros/lib", "LD_LIBRARY_PATH"))
    transforms = peer.hear(TFMessage, "/tf")
    with NodeProcess("mrm_description.launch.mrm_bringup", "viewer:=none"):
        wait_for(lambda: transforms, "a transform")
        domain, node = f"ROS_DOMAIN_ID={ros_domain}\0", "onebot_description.robot_state_publisher"
        [publisher] = marked(domain, node)
        assert "libtf2_msgs" in Path(f"/proc/{publisher}/maps").read_text()


@pytest.mark.slow
def test_a_genuine_client_moves_the_robot(ros_domain: int, tmp_path: Path) -> None:
    """Its types have our hashes and descriptions, and genuine_client.py is what it sees."""
    if PathFinder.find_spec(PACKAGE) is not None:
        skip_for(f"an environment without {PACKAGE}, in which the node makes its own types")

    genuine = tmp_path / "genuine"
    build(genuine, PACKAGE)
    compare_descriptions(genuine / "src/rosidl_generator_c")

    robot, control = tmp_path / "arm.urdf", tmp_path / "control.yaml"
    robot.write_text(ROBOT.urdf)
    control.write_text(CONTROL.replace("[tilt, pan]", "[tilt]") + OLDER_GRIPPER)
    given = ["--params-file", str(control), "-p", "use_sim_time:=true"]
    with NodeProcess(MODULE, str(robot), "--ros-args", *given) as node:
        run(
            *("-m", "pytest", "-n", "0", "-p", "no:cacheprovider"),
            "tests/onebot_control/genuine_client.py",
            PYTHONPATH=before(genuine, "PYTHONPATH"),
            LD_LIBRARY_PATH=before(genuine / "lib", "LD_LIBRARY_PATH"),
            GENUINE_CONTROL_MSGS=str(genuine),
        )
        # The node had the package neither from there nor from anywhere else.
        assert f"lib{PACKAGE}" not in Path(f"/proc/{node.process.pid}/maps").read_text()


def compare_descriptions(generated: Path) -> None:
    """Each of our types is described as the generators describe it, with the same hash."""
    names = types_of(PACKAGE)
    assert len(names) > 5
    for kind in (kind for name in names for kind in classes_of(name)):
        folder = kind.__module__.split(".")[1]
        name = f"{PACKAGE}/{folder}/{kind.__name__}"
        assert described(kind) == generated_description(name, generated)
