"""Runs test suites of others, unmodified: ``python -m tests.peer_suites FOLDER``.

FOLDER has checkouts of the repositories in ``SUITES``, and navigation2, of ROS 2 Jazzy, by their
names. Each file runs in a process of its own; a row says what came of it.

Clients of Nav2 run beside a robot that navigates in the maze, in the given map, on simulated time;
only the poses in them are replaced. ``python -m tests.peer_suites FOLDER nav2 [N]`` runs only them,
N times.
"""

import math
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import yaml
from nav_msgs.msg import Odometry

from onebot_control import Simulation
from onebot_control.navigation.map_files import save_map
from onebot_description.ros.domains import used_domain
from tests.ros_support import NodeProcess, Peer
from tests.support import wait_for

SUITES = {
    "geometry2": (
        "tf2_py/test/test_buffer_core.py",
        "tf2_ros_py/test/test_buffer.py",
        "tf2_ros_py/test/test_buffer_client.py",
        "tf2_ros_py/test/test_listener_and_broadcaster.py",
        "tf2_geometry_msgs/test/test_tf2_geometry_msgs.py",
        "tf2_sensor_msgs/test/test_tf2_sensor_msgs.py",
    ),
    "message_filters": (
        "test/directed.py",
        "test/test_approxsync.py",
        "test/test_message_filters_cache.py",
    ),
    "common_interfaces": ("sensor_msgs_py/test/test_point_cloud2.py",),
    "tf_transformations": ("test/test_transformations.py",),
    "angles": ("angles/test/utest.py",),
}
_PYTEST = (
    "import sys, onebot_description, pytest; "
    "sys.exit(pytest.main(['-q', '-p', 'no:cacheprovider', '--import-mode=importlib', '-p', "
    "'no:onebot_bringup.testing.plugin', '-c', '/dev/null', sys.argv[1]]))"
)


class Program(NamedTuple):
    """A client of Nav2."""

    file: str
    pattern: str  # what it prints at its good end
    end: Sequence[float]  # where the robot is then, from its start, m
    poses: dict[str, str] = {}  # poses that are replaced; those of the start are added to them
    words: str = ""


PROGRAMS = [Program(**row) for row in yaml.safe_load(Path("tests/nav2_clients.yaml").read_text())]
_START = 2.0, 0.5  # where the robot starts in the maze, m
_NEAR = 0.05  # m from the end
_FACTOR = float(os.environ.get("REAL_TIME_FACTOR", "1.0"))


def client_outcome(folder: Path, program: Program, scratch: Path) -> tuple[bool, str]:
    """Return whether a client ends well with the robot where it is to be, and what came of it."""
    text = (folder / program.file).read_text()
    for old, new in program.poses.items():
        text = text.replace(old, new)
    file, (x, y) = scratch / Path(program.file).name, _START
    text = re.sub(
        r"(position\.([xy]) = )(-?[\d.]+)$",
        lambda found: f"{found[1]}{float(found[3]) + (x if found[2] == 'x' else y)}",
        text,
        flags=re.MULTILINE,
    )
    text = re.sub(
        r"\[(-?\d[\d.]*), (-?\d[\d.]*)(?=[,\]])",
        lambda found: f"[{float(found[1]) + x}, {float(found[2]) + y}",
        text,
    )
    file.write_text(text)
    given = save_map(Simulation(world="maze").occupancy_grid(0.05), scratch / "maze")
    words = f"world:=maze x:={x} y:={y} sensors_enabled:=true navigate:=true viewer:=none"
    with (
        used_domain() as domain,
        Peer(domain) as peer,
        NodeProcess(
            "onebot_bringup.launch.onebot_bringup",
            *words.split(),
            f"map:={given}",
            "use_sim_time:=true",
            f"real_time_factor:={_FACTOR}",
        ),
    ):
        truth = peer.hear(Odometry, "velocity_controller/ground_truth")
        sim_time = "--ros-args", "-p", "use_sim_time:=true"
        run = subprocess.Popen(
            [sys.executable, "-u", str(file), *program.words.split(), *sim_time],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "PYTHONPATH": str(folder / "nav2_simple_commander")},
        )
        assert run.stdout is not None
        lines = list[str]()
        for line in run.stdout:
            lines.append(line)
            if "Restarting" in line:  # it never ends
                run.kill()
        run.wait()
        wait_for(lambda: truth, "the robot")
        at = truth[-1].pose.pose.position
        away = math.dist((at.x - x, at.y - y), program.end)
    good = any(program.pattern in line for line in lines)
    return good and not away > _NEAR, f"{lines[-1].strip()}; {away:.3f} m" if lines else "nothing"


def outcome(file: Path, aliases: Path) -> tuple[bool, str]:
    """Return whether the tests of a file pass, and pytest's last line."""
    with used_domain():
        run = subprocess.run(
            [sys.executable, "-c", _PYTEST, str(file)],
            capture_output=True,
            text=True,
            timeout=600,
            env={**os.environ, "PYTHONPATH": f"{os.getcwd()}:{aliases}"},
        )
    last = (run.stdout.strip() or run.stderr.strip()).splitlines()[-1]
    return run.returncode == 0, re.sub(r" in [0-9.]+s.*", "", last)


def main(folder: Path, only_clients: bool = False, rounds: int = 1) -> int:
    """Print a row for each file; return how many failed."""
    failures = 0
    print("| Repository | Tests | Outcome |\n|---|---|---|")
    with tempfile.TemporaryDirectory() as scratch:
        for program in PROGRAMS * rounds:
            passed, text = client_outcome(folder / "navigation2", program, Path(scratch))
            failures += not passed
            result = "passed" if passed else "FAILED"
            print(f"| navigation2 | {program.file} | {result}: {text} |", flush=True)
    if only_clients:
        return failures
    with tempfile.TemporaryDirectory() as aliases:
        # The build of tf2_py puts the module that is tested there.
        package = Path(aliases, "test_tf2_py")
        package.mkdir()
        (package / "__init__.py").touch()
        (package / "_tf2_py.py").write_text("from tf2_py._tf2_py import *\n")
        for repository, files in SUITES.items():
            for file in files:
                passed, text = outcome(folder / repository / file, Path(aliases))
                failures += not passed
                print(f"| {repository} | {file} | {text} |", flush=True)
    return failures


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    sys.exit(main(Path(sys.argv[1]), "nav2" in sys.argv, int(sys.argv[3]) if sys.argv[3:] else 1))
