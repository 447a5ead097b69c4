"""The examples, each copied into an empty folder and run as its docstring says."""

import os
import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from nav_msgs.msg import Odometry
from PIL import Image
from rclpy.serialization import deserialize_message

from onebot_bringup.bags.bag_reader import Bag
from onebot_control.navigation.map_files import load_map
from tests.onebot_bringup.cli_support import onebot
from tests.readme import CHECKOUT
from tests.ros_support import NodeProcess, Peer
from tests.support import PATIENCE, RunningProcess, run_to_end, wait_for
from tests.support_rendering import require_renderer

EXAMPLES = sorted((CHECKOUT / "onebot_bringup/examples").iterdir())
SCRIPTS = [path for path in EXAMPLES if path.suffix == ".py"]
_NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e-?\d+)?")
_MOST_LINES = 30
BRINGUP = "onebot_bringup.launch.onebot_bringup"


def _command(path: Path) -> list[str]:
    """The words that the docstring of an example says to run it with."""
    commands = re.findall(r"^Run it with `(.*?)`\.", path.read_text(), re.MULTILINE)
    assert len(commands) == 1, path
    return str(commands[0]).split()


@pytest.fixture
def run(tmp_path: Path) -> Callable[[str], list[str]]:
    """Runs an example by the beginning of its name; returns the lines that it has printed."""

    def run_example(name: str) -> list[str]:
        [path] = [each for each in SCRIPTS if each.name.startswith(name)]
        (tmp_path / path.name).write_text(path.read_text())
        program, *words = _command(path)
        programs = {"python": [], "pytest": ["-m", "pytest", "-p", "no:cacheprovider"]}
        search = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
        done = run_to_end(
            [sys.executable, *programs[program], *words],
            cwd=tmp_path,
            env={**os.environ, "PATH": search},
            timeout=5 * PATIENCE,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout.splitlines()

    return run_example


def _numbers(line: str) -> list[float]:
    return [float(number) for number in _NUMBER.findall(line)]


def test_each_example_is_in_the_table_and_is_tested_here() -> None:
    """Under its name; it has at most 30 lines."""
    table = (CHECKOUT / "onebot_bringup/README.md").read_text()
    rows = re.findall(r"^\| \[(\S+)\]\(examples/(\S+)\) \|", table, re.MULTILINE)
    names = [path.name for path in SCRIPTS]
    assert rows == [(name, name) for name in names]
    assert all(len(path.read_text().splitlines()) <= _MOST_LINES for path in SCRIPTS)
    source = Path(__file__).read_text()
    tested = re.findall(r'run\("(\w+)"\)|== "(\w+)\.py"', source)
    assert ["".join(each) for each in tested] == [name.removesuffix(".py") for name in names]


@pytest.mark.slow
def test_view_prints_where_links_are_and_draws_them(run, tmp_path: Path) -> None:
    require_renderer()
    title, *links = run("01_view")[:6]
    assert title.startswith("onebot: ") and "caster_swivel_joint" in title
    poses = {line.split()[0]: _numbers(line)[-3:] for line in links}
    assert poses["left_wheel"] == pytest.approx([0.0, 0.15, 0.0], abs=1e-3)
    # The caster has turned by 90 degrees: its wheel is beside its axis instead of behind it.
    swivel, wheel = poses["caster_base2"], poses["caswheel"]
    assert wheel[0] == pytest.approx(swivel[0], abs=1e-3) and wheel[1] == pytest.approx(-0.02)
    picture = np.asarray(Image.open(tmp_path / "view.png").convert("RGB"))
    assert picture.shape == (720, 1280, 3) and len(np.unique(picture)) > 50


def test_drive_ends_where_it_began(run) -> None:
    *corners, end = run("02_drive")
    places = [_numbers(line)[1:3] for line in corners]
    square = [[1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [0.0, 0.0]]
    assert np.array(places) == pytest.approx(np.array(square), abs=0.005)
    assert all(_numbers(line)[-1] < 2.0 for line in corners)  # mm
    assert _numbers(end) == [28.0]


def test_sense_measures_as_exactly_as_the_sensors_are(run, tmp_path: Path) -> None:
    *ahead, nearest, imu, camera = run("03_sense")
    assert len(ahead) == 4
    for line in ahead:
        _, measured, exact = _numbers(line)
        assert measured == pytest.approx(exact, abs=0.03)  # The noise is 5 mm.
    assert _numbers(ahead[-1])[2] == pytest.approx(_numbers(ahead[0])[2] - 1.5, abs=0.01)
    assert _numbers(nearest) == pytest.approx([0.38], abs=0.02)  # to the walls at both sides
    assert _numbers(imu)[0] == pytest.approx(9.81, abs=0.1)
    width, height, middle = _numbers(camera)
    assert Image.open(tmp_path / "camera.png").size == (width, height) == (160, 120)
    assert 0.0 < _numbers(ahead[-1])[2] - middle < 0.2  # The camera is before the lidar.


def test_fleet_keeps_its_distances(run) -> None:
    leader, *followers = run("04_fleet")
    assert _numbers(leader) == pytest.approx([1.8], abs=0.01)
    assert [line.split()[0] for line in followers] == ["second", "third", "fourth"]
    assert [_numbers(line)[-1] for line in followers] == pytest.approx([0.5] * 3, abs=0.01)


@pytest.mark.slow
def test_lockstep_is_equal_twice(run, ros_domain: int) -> None:
    first, second = run("05_lockstep")
    assert first == second
    assert _numbers(first)[-1] == pytest.approx(1.0, abs=0.01)


@pytest.mark.slow
@pytest.mark.checkout
def test_a_test_of_a_node_passes(run, ros_domain: int) -> None:
    """The fixture is found by the installation's entry point."""
    assert "2 passed" in run("06_test_stopper")[-1]


@pytest.mark.slow
def test_record_and_replay_leaves_the_drive_in_both_files(run, ros_domain: int, tmp_path) -> None:
    lines = run("07_record_and_replay")
    [commands] = [line for line in lines if "Topic: /velocity_controller/cmd_vel |" in line]
    assert "Count: 150 |" in commands
    folder, recording = sorted(tmp_path.glob("drive-*"))
    bag = Bag(folder)
    *_, last = bag.messages({"/velocity_controller/odom"})
    pose = deserialize_message(last.data, Odometry).pose.pose
    # On a circle of 1 m radius, after at most 3 s at 0.3 m/s and the timeout of the last command.
    x, y = pose.position.x, pose.position.y
    assert np.hypot(x, y - 1.0) == pytest.approx(1.0, abs=0.1) and x > 0.4
    assert recording.suffix == ".rrd" and recording.stat().st_size > 50_000  # bytes


def test_arm_holds_against_gravity(run) -> None:
    shoulder, elbow, gravity = run("08_arm")
    # 1 kg with its middle 0.2 m along each link of 0.4 m, at these angles from the vertical
    below = 9.81 * 0.2 * np.sin(1.5)
    above = 9.81 * (0.2 + 0.4) * np.sin(0.5)
    assert _numbers(shoulder) == pytest.approx([0.5, above + below], abs=0.01)
    assert _numbers(elbow) == pytest.approx([1.0, below], abs=0.01)
    assert _numbers(gravity) == pytest.approx([below], abs=0.001)


def test_grasp_lifts_the_box(run) -> None:
    grip, box = run("09_grasp")
    assert _numbers(grip) == pytest.approx([25.0, 10.0], abs=0.2)  # mm, N: half of the box's edge
    assert _numbers(box) == pytest.approx([125.0], abs=0.2)  # half of its edge, and 100 mm


def test_panda_reaches_the_point(run) -> None:
    [line] = run("10_panda")
    assert _numbers(line)[1:] == pytest.approx([0.4, 0.2, 0.5], abs=1e-4)


@pytest.mark.slow
def test_node_drives_a_circle_beside_the_robot(ros_domain: int) -> None:
    """It is the one that runs until Ctrl-C."""
    file = next(str(path) for path in SCRIPTS if path.name == "11_node.py")
    with Peer(ros_domain) as peer, NodeProcess(BRINGUP, "viewer:=none"):
        truth = peer.hear(Odometry, "/velocity_controller/ground_truth")
        with RunningProcess([sys.executable, file]) as node:
            wait_for(lambda: truth and truth[-1].pose.pose.position.y > 1.0, "half a circle")
            wait_for(lambda: re.search(r"at -?\d\.\d\d, -?\d\.\d\d m", node.output), "its log")
    places = np.array([[t.pose.pose.position.x, t.pose.pose.position.y - 1.0] for t in truth])
    # On a circle of 1 m radius, but for the start, where it speeds up
    assert np.hypot(*places.T) == pytest.approx(1.0, abs=0.1)


def test_learn_plays_an_episode(run) -> None:
    [line] = run("12_learn")
    steps, reward, left = _numbers(line)
    assert 10 < steps <= 100 and -2.0 * steps < reward < -0.2 * steps and 0.1 < left < 2.0


def test_study_finds_the_better_gain(run) -> None:
    """It is a study for ``onebot evaluate``, too: the README's commands."""
    lines = run("13_study")
    shares = {line.split()[1]: line for line in lines if line.startswith("  gain")}
    assert "10 of 10" in shares["1.0"] and int(shares["0.2"].split()[2]) < 5
    assert lines[0] == "episode: 20 episodes, 0 with an error"


def test_go_to(run: Callable[[str], list[str]], tmp_path: Path) -> None:
    """It arrives within the tolerance, and its map can be read."""
    *way, goal, belief = run("14_go_to")
    assert "arrived" in way[-1] and "driving" in way[0]
    assert _numbers(goal)[0] <= 50.0 and _numbers(belief)[0] <= 30.0
    data = load_map(tmp_path / "maze.yaml").data
    assert (data == 100).sum() > 50 and (data == 0).sum() > 1000


@pytest.mark.slow
def test_worlds_are_crossed() -> None:
    """Each of its cases; this is the first in the densest."""
    [path] = [each for each in SCRIPTS if each.name == "15_worlds.py"]
    assert _command(path)[:3] == ["onebot", "evaluate", path.name]
    done = onebot("evaluate", str(path), "--case", "200")
    assert "density: 0.25\nseed: 0\nreached: True\n" in done.stdout, done
