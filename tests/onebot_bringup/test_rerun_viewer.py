"""The rerun_viewer node, fed over real DDS."""

import errno
import os
import re
import resource
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote

import psutil
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Transform, TransformStamped, Vector3
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String

from onebot_bringup.viewer.rendering import headless_viewer, still
from onebot_bringup.viewer.rrd import has_content
from onebot_bringup.viewer.viewer_parameters import ViewerParameters
from onebot_description.parameters.reader import ConfigError, read
from onebot_description.wire.tf_message import TFMessage
from tests.onebot_bringup.drive_support import chunks, stamps, while_written
from tests.onebot_bringup.viewer_support import ARM, BLUE, ORANGE, viewer_node
from tests.ros_support import LATCHED, NodeProcess, Peer
from tests.support import lines_of_ours, used_domain, wait_for
from tests.support_rendering import center, colored, pixels, require_renderer


def _edge(parent: str, child: str, y: float, seconds: int) -> TFMessage:
    edge = TransformStamped(
        header=Header(stamp=Time(sec=seconds), frame_id=parent),
        child_frame_id=child,
        transform=Transform(translation=Vector3(y=y)),
    )
    return TFMessage(transforms=[edge])


class Robot:
    """Publishes the arm's topics as the other nodes would."""

    def __init__(self, peer: Peer, urdf: str = ARM, space: str = "") -> None:
        self.seconds = 1000
        self._description = peer.publisher(String, f"{space}robot_description", LATCHED)
        self._tf = peer.publisher(TFMessage, "tf")
        reliable = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE)
        self._joints = peer.publisher(JointState, f"{space}joint_states", reliable)
        self.describe(urdf)

    def describe(self, urdf: str) -> None:
        self._description.publish(String(data=urdf))

    def move(self, y: float = 1.0, child: str = "tip") -> None:
        self.seconds += 1
        self._tf.publish(_edge("base", child, y, self.seconds))
        header = Header(stamp=Time(sec=self.seconds))
        self._joints.publish(
            JointState(header=header, name=["slide"], position=[y], velocity=[0.5])
        )


def viewer_uri(peer: Peer) -> str:
    """Where native viewers connect, as the node publishes it."""
    pages = peer.hear(String, "/rerun_viewer/page", LATCHED)
    page = wait_for(lambda: [page.data for page in pages if page.data], "the page's address")[-1]
    return re.search(r"[?&]url=([^&]+)", unquote(page))[1]


def _page(node: NodeProcess) -> str:
    return wait_for(lambda: re.search(r"open (http://127\.0\.0\.1:\d+)", node.output), "the page")[
        1
    ]


@pytest.mark.slow
def test_late_viewers_and_the_file_show_the_robot(ros_domain, tmp_path):
    """A viewer joining later, and the file opened after the end, show link by link what moved."""
    require_renderer()
    file = tmp_path / "run.rrd"
    with viewer_node(tmp_path, viewer="web", save=file) as node, Peer(ros_domain) as peer:
        robot = Robot(peer)
        wait_for(lambda: 'showing "arm" (2 links)' in node.output, "the robot")
        robot.move(0.2)
        robot.move(1.0)
        uri = viewer_uri(peer)

        with headless_viewer(uri, 640, 480) as client:

            def moved():
                robot.move(1.0)
                image = pixels(still(client))
                blue, orange = colored(image, BLUE), colored(image, ORANGE)
                return blue.any() and orange.any() and center(blue)[0] < 0.5 < center(orange)[0]

            wait_for(moved, "the tip on the right of the base")
            graph = client.get_transform_graph(frame_filter="named")
            assert [(e["parent"], e["child"]) for e in graph["edges"]] == [("base", "tip")]
            assert [view.reports for view in client.get_state().views] == [[]]
        assert node.interrupt() == 0
    assert has_content(file)


class Shown(NamedTuple):
    """A viewer that writes a file, and the robot that it shows."""

    node: NodeProcess
    robot: Robot
    file: Path

    def describe(self, urdf: str, text: str) -> None:
        """Publish a description, and wait for what it logs of that."""
        before = len(self.node.output)
        self.robot.describe(urdf)
        wait_for(lambda: text in self.node.output[before:], f'"{text}"')


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Shown]:
    """One viewer for the tests that leave it as it was: showing the arm."""
    folder = tmp_path_factory.mktemp("shown")
    file = folder / "x.rrd"
    with used_domain() as domain, viewer_node(folder) as node:
        wait_for(lambda: "waiting for the robot's description" in node.output, "the hint")
        with Peer(domain) as peer:
            robot = Robot(peer)
            wait_for(lambda: 'showing "arm"' in node.output, "the robot")
            yield Shown(node, robot, file)


def test_an_edited_description_is_shown_live_and_a_broken_one_is_not(shown):
    """The node says what it shows; broken text keeps the robot and is named."""
    shown.describe(ARM[:-9], "keeping the robot shown so far")
    shown.describe(ARM.replace('name="arm"', 'name="longer"'), 'showing "longer"')
    shown.describe(ARM, 'showing "arm"')


def test_robots_of_several_namespaces_are_shown(ros_domain, tmp_path):
    """Those that the parameter names, each under its namespace; one that is not there is named."""
    file = tmp_path / "x.rrd"
    robots = "[left, /right, later]"
    with viewer_node(tmp_path, robots=robots) as node, Peer(ros_domain) as it:
        alike, other = Robot(it, space="left/"), Robot(it, ARM.replace("arm", "leg"), "right/")
        wait_for(lambda: 'showing "arm" (2 links) in /left' in node.output, "one robot")
        wait_for(lambda: 'showing "leg" (2 links) in /right' in node.output, "the other")
        wait_for(lambda: "no description yet of the robots in /later" in node.output, "the third")
        alike.move()
        other.move()
        for entity in ("/left/joints/position/0", "/right/joints/position/0"):
            wait_for(lambda: while_written(chunks, file, entity), entity)  # noqa: B023
        assert node.interrupt() == 0


@pytest.mark.parametrize("end", [signal.SIGTERM, signal.SIGKILL])
def test_no_process_outlives_the_node(ros_domain, tmp_path, end):
    """Whatever ends it, its page's server ends, too."""
    with viewer_node(tmp_path, viewer="web", check=False) as node:
        _page(node)
        children = psutil.Process(node.process.pid).children(recursive=True)
        assert children
        node.process.send_signal(end)
        assert node.wait() == (-9 if end == signal.SIGKILL else 0)
        wait_for(lambda: not any(child.is_running() for child in children), "its children's end")


def test_a_port_in_use_is_said_and_replaced(ros_domain, tmp_path):
    """Two viewers can run at once."""
    with viewer_node(tmp_path, viewer="web") as first:
        port = int(_page(first).rpartition(":")[2])
        with viewer_node(tmp_path, viewer="web", web_port=port) as second:
            assert int(_page(second).rpartition(":")[2]) != port
            assert f"web_port {port} is in use; using" in second.output


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"viewer": "rviz"}, ['viewer: no "rviz" (known: native, none, web)']),
        ({"view": "/nowhere/view.yaml"}, ["/nowhere/view.yaml: cannot be read: No such file"]),
        ({"view": "/nowhere/view.rbl"}, ["/nowhere/view.rbl: there is no such file"]),
        (
            {"view": "none", "axes.length": -1.0, "camera.eye": "[1.0]", "panels.top": "open"},
            [
                "axes.length: -1 is below 0; write a number from 0",
                "camera.eye: 1 numbers; write three metres",
                'panels.top: no "open" (known: collapsed, expanded, hidden)',
            ],
        ),
    ],
)
def test_wrong_parameters_are_one_clear_error(ros_domain, tmp_path, parameters, said):
    """With all that is wrong, exit code 1, no traceback."""
    with viewer_node(tmp_path, check=False, **parameters) as node:
        assert node.wait() == 1
        assert node.output.count("error:") == 1 and "Traceback" not in node.output
        for sentence in said:
            assert sentence in node.output


def test_a_full_disk_is_one_clear_error(ros_domain, tmp_path):
    """Without a traceback, Rerun's or Python's."""
    file = tmp_path / "x.rrd"
    with viewer_node(tmp_path, check=False) as node, Peer(ros_domain) as peer:
        robot = Robot(peer)
        wait_for(lambda: 'showing "arm"' in node.output, "the robot")
        size = file.stat().st_size
        resource.prlimit(node.process.pid, resource.RLIMIT_FSIZE, (size, size))
        wait_for(lambda: robot.move() or node.process.poll() is not None, "the end")
        assert node.wait() == 1
        limit = f"error: save:={file}: {os.strerror(errno.EFBIG)}"
        assert lines_of_ours(node.output)[-1] == limit
        for word in ("Traceback", "Error occurred", "ERROR", "FATAL"):
            assert word not in node.output


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({"memory_limit": "lots"}, '"lots" is not possible; write a size such as 256MB'),
        ({"memory_limit": "10 MB"}, None),
        ({"web_port": 65536}, "65536 is above 65535; write a number from 0 to 65535"),
    ],
)
def test_values_of_parameters(parameters, said):
    """What each may be, and what is said of another."""
    if said is None:
        read(ViewerParameters, parameters)
        return
    with pytest.raises(ConfigError, match=re.escape(said)):
        read(ViewerParameters, parameters)


def test_nothing_to_show_is_said(ros_domain, tmp_path):
    """With viewer:=none and no file the node lives on, so that a launch file need not differ."""
    with viewer_node(tmp_path, save='""') as node:
        wait_for(lambda: "nothing will be shown" in node.output, "the warning")


def test_bytes_that_are_no_message_are_warned_of_by_topic(shown):
    """Once in some seconds for each; the good ones that come with them are in the file."""
    garbage = b"\0\1\0\0\xff\xff\xff\xff\0\0\0\0"
    robot = shown.robot

    def warned() -> bool:
        for publisher in (robot._tf, robot._joints):
            publisher.publish(garbage)
        robot.move(0.5)
        said = "ignored a message of {}: no "
        return all(said.format(topic) in shown.node.output for topic in ("/tf", "/joint_states"))

    wait_for(warned, "the warnings")
    last = robot.seconds * 10**9
    wait_for(
        lambda: last in while_written(stamps, shown.file, "/tf"), "the good messages in the file"
    )
