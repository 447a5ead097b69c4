"""A client with control_msgs as everyone else has it, built here by ROS's own generators.

The types that this project makes of definitions are tested with themselves everywhere else; here
they meet types of another origin, with which they share neither code nor memory.
"""

import importlib.util
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from tests.onebot_control.arm_support import CONTROL, MODULE, ROBOT
from tests.onebot_description.test_interfaces import (
    OWN,
    classes_of,
    described,
    generated_description,
)
from tests.ros_support import NodeProcess
from tests.support import require, require_program, skip_for

PACKAGE = "control_msgs"
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


@pytest.mark.slow
def test_a_genuine_client_moves_the_robot(ros_domain: int, tmp_path: Path) -> None:
    """Its types have our hashes and descriptions, and genuine_client.py is what it sees."""
    for compiler, package in (("cc", "gcc"), ("c++", "g++")):
        require_program(compiler, package)
    header = Path(sysconfig.get_path("include"), "Python.h")
    require(header.is_file(), str(header), "python3-dev")
    if importlib.util.find_spec(PACKAGE) is not None:
        skip_for(f"an environment without {PACKAGE}, in which the node makes its own types")

    genuine = tmp_path / "genuine"
    run("-m", "tests.onebot_control.genuine_control_msgs", str(genuine))
    compare_descriptions(genuine / "src/rosidl_generator_c")

    robot, control = tmp_path / "arm.urdf", tmp_path / "control.yaml"
    robot.write_text(ROBOT.urdf)
    control.write_text(CONTROL)
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
    names = [name for name in OWN if name.startswith(f"{PACKAGE}/")]
    assert len(names) > 5
    for kind in (kind for name in names for kind in classes_of(name)):
        folder = kind.__module__.split(".")[1]
        name = f"{PACKAGE}/{folder}/{kind.__name__}"
        assert described(kind) == generated_description(name, generated)
