"""Robot, driver and viewer on three hosts, by the network alone; one is cut off and joins again."""

import re
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.hosts import Host, connected_hosts, missing
from tests.support import PATIENCE, RunningProcess, skip_for, wait_for

ONEBOT = "onebot_bringup.cli.main"
SERVER_PORT = 11811
SPEED = 0.2  # m/s
CUT = 5.0  # s: shorter than the 20 s for which Fast DDS remembers who is silent


class Fleet(ExitStack):
    """The three hosts, and what runs on them until the end of the context."""

    def __init__(
        self, hosts: list[Host], folder: Path, discovery: str, namespace: str = ""
    ) -> None:
        super().__init__()
        self.namespace = namespace  # of the robot
        self.robot_host, self.driver_host, self.viewer_host = hosts
        self.folder, self._discovery = folder, discovery

    def run(self, host: Host, *words: str) -> RunningProcess:
        return self.enter_context(RunningProcess(host.command(words), check=False))

    def onebot(self, host: Host, *words: str) -> RunningProcess:
        discovery = f"discovery:={self._discovery}"
        return self.run(host, sys.executable, "-um", ONEBOT, discovery, *words)

    def start_robot(self, *arguments: str) -> RunningProcess:
        """Start the robot, and print its odometry on the same host."""
        module = "onebot_bringup.launch.onebot_bringup"
        words = (f"discovery:={self._discovery}", "viewer:=none", *arguments)
        robot = self.run(self.robot_host, sys.executable, "-m", module, *words)
        field = "twist.twist.linear.x"
        self._odom = self.onebot(
            self.robot_host, "topic", "echo", "--csv", "--field", field, self.odom
        )
        return robot

    def drive(self) -> RunningProcess:
        """Drive the robot from the driver's host."""
        words = ("topic", "pub", "-r", "20", self.cmd_vel, "geometry_msgs/msg/Twist")
        return self.onebot(self.driver_host, *words, f"{{linear: {{x: {SPEED}}}}}")

    def start_viewer(self) -> Path:
        """Start the viewer; return the recording that it writes."""
        file = self.folder / "viewer.rrd"
        prefix = ("-p", f"frame_prefix:={self.namespace[1:]}/") if self.namespace else ()
        self.onebot(
            self.viewer_host, "run", "onebot_bringup", "rerun_viewer",
            "--ros-args", "-r", f"__ns:={self.namespace or '/'}", "-p", "viewer:=none",
            "-p", f"save:={file}", *prefix,
        )  # fmt: skip
        return file

    @property
    def cmd_vel(self) -> str:
        return f"{self.namespace}/velocity_controller/cmd_vel"

    @property
    def odom(self) -> str:
        return f"{self.namespace}/velocity_controller/odom"

    @property
    def cycles(self) -> list[float]:
        """The robot's speed, in each control cycle so far."""
        lines = self._odom.output.split("\n")[:-1]
        return [float(line) for line in lines if re.fullmatch(r"[-+.e\d]+", line)]

    def drives(self) -> bool:
        return self.cycles[-1:] != [] and self.cycles[-1] > 0.9 * SPEED

    def rests(self) -> bool:
        return abs(self.cycles[-1]) < 0.01 * SPEED


@pytest.fixture
def hosts(ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Host]]:
    if problem := missing():
        skip_for(problem)
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE")
    with connected_hosts("robot", "driver", "viewer") as made:
        yield made


def grows(file: Path, by: int = 100_000) -> None:
    """Wait until a recording has grown."""
    before = file.stat().st_size
    wait_for(lambda: file.stat().st_size > before + by, f"{file.name} to grow")


@pytest.mark.slow
def test_all_carry_on_after_the_robot_was_cut_off(hosts: list[Host], tmp_path: Path) -> None:
    """On a subnet: it stops by its timeout, its control loop runs on, and nothing is restarted."""
    with Fleet(hosts, tmp_path, "subnet") as fleet:
        robot = fleet.start_robot()
        recording = fleet.start_viewer()
        driver = fleet.drive()
        wait_for(fleet.drives, "the robot to drive")
        wait_for(recording.exists, "the recording")
        grows(recording)

        fleet.robot_host.plug(False)
        began, cycles = time.monotonic(), len(fleet.cycles)
        wait_for(fleet.rests, "the robot to stop")
        time.sleep(max(0.0, began + CUT - time.monotonic()))
        # Waiting for Linux to find the others, it would stand still for 2.6 of each 3 s.
        assert len(fleet.cycles) - cycles > 0.4 * 50.0 * CUT and fleet.rests()
        fleet.robot_host.plug(True)

        wait_for(fleet.drives, "the robot to drive again")
        grows(recording)
        fleet.viewer_host.plug(False)
        fleet.viewer_host.plug(True)
        grows(recording)
        for command in (robot, driver):
            assert command.process.poll() is None, command.output


@pytest.mark.slow
def test_a_discovery_server_connects_the_hosts(hosts: list[Host], tmp_path: Path) -> None:
    """Robots that started before it join when it runs; lists are of all; a cut is survived."""
    address = f"{hosts[2].address}:{SERVER_PORT}"
    with Fleet(hosts, tmp_path, address, "/robot2") as fleet:
        robot = fleet.start_robot("robots:=2")
        robot.says(f"no other node is discovered: is the discovery server at {address} running")
        fleet.drive()
        server = ("fastdds", "discovery", "-i", "0", "-p", str(SERVER_PORT))
        fleet.run(fleet.viewer_host, *server)
        wait_for(fleet.drives, "the robot to drive")
        recording = fleet.start_viewer()
        wait_for(recording.exists, "the recording")
        grows(recording)
        # Of what it neither publishes nor subscribes to itself.
        listed = fleet.onebot(fleet.viewer_host, "topic", "list")
        listed.process.wait(PATIENCE)
        assert {fleet.cmd_vel, fleet.odom, "/robot1/joint_states"} <= set(listed.output.split()), (
            listed.output
        )

        fleet.driver_host.plug(False)
        wait_for(fleet.rests, "the robot to stop")
        fleet.driver_host.plug(True)
        wait_for(fleet.drives, "the robot to drive again")
