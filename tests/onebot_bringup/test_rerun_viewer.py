"""The rerun_viewer node, fed over real DDS."""

import errno
import os
import re
import resource
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import psutil
import pytest
from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from std_srvs.srv import Trigger

from onebot_bringup.viewer.live_view import LiveView
from onebot_bringup.viewer.rerun_viewer import PageCameras, RerunViewer
from onebot_bringup.viewer.view_config import load_view
from onebot_bringup.viewer.viewer_parameters import ViewerParameters
from onebot_description.errors import OneBotError
from onebot_description.parameters.reader import read
from onebot_description.ros.domains import used_domain
from onebot_description.ros.node_parameters import declare
from onebot_description.ros.wire.interfaces import TFMessage
from onebot_description.ros.wire.messages import transforms_message
from tests.onebot_bringup.drive_support import chunks, while_written
from tests.onebot_bringup.viewer_support import ARM, VIEW, viewer_node
from tests.ros_support import LATCHED, NodeProcess, Peer, spin_until
from tests.support import lines_of_ours, wait_for

NODE = "/rerun_viewer"


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
        stamp, place = Time(sec=self.seconds), np.array([[0.0, y, 0.0, 0.0, 0.0, 0.0, 1.0]])
        self._tf.publish(transforms_message(stamp, ["base"], [child], place))
        header = Header(stamp=stamp)
        self._joints.publish(
            JointState(header=header, name=["slide"], position=[y], velocity=[0.5])
        )


def _page(node: NodeProcess) -> str:
    return wait_for(lambda: re.search(r"open (http://127\.0\.0\.1:\d+)", node.output), "the page")[
        1
    ]


class Shown(NamedTuple):
    """A viewer with a page, that writes a file, too, and the robot that it shows."""

    node: NodeProcess
    peer: Peer
    robot: Robot
    folder: Path  # of x.rrd and view.yaml

    def describe(self, urdf: str, text: str) -> None:
        """Publish a description, and wait for what it logs of that."""
        before = len(self.node.output)
        self.robot.describe(urdf)
        wait_for(lambda: text in self.node.output[before:], f'"{text}"')


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Shown]:
    """One viewer for the tests that leave it as it was: showing the arm."""
    folder = tmp_path_factory.mktemp("shown")
    with used_domain() as domain, viewer_node(folder, viewer="web") as node:
        wait_for(lambda: "waiting for the robot's description" in node.output, "the hint")
        with Peer(domain) as peer:
            robot = Robot(peer)
            wait_for(lambda: 'showing "arm"' in node.output, "the robot")
            yield Shown(node, peer, robot, folder)


def test_an_edited_description_is_shown_live_and_a_broken_one_is_not(shown):
    """The node says what it shows; broken text is named."""
    shown.describe(ARM[:-9], "ignored a message of /robot_description")
    shown.describe(ARM.replace('name="arm"', 'name="longer"'), 'showing "longer"')
    shown.describe(ARM, 'showing "arm"')


def test_several_robots_are_shown_until_the_disk_is_full(ros_domain, tmp_path):
    """Those that the parameter names, below the node's own; one that is not there is named.

    A full disk is one clear error, without a traceback, Rerun's or Python's.
    """
    file, words = tmp_path / "x.rrd", ("-r", "__ns:=/r1")
    names = {"robots": "[left, /right, later]"}
    with viewer_node(tmp_path, VIEW, *words, check=False, **names) as node, Peer(ros_domain) as it:
        alike, other = Robot(it, space="r1/left/"), Robot(it, ARM.replace("arm", "leg"), "right/")
        wait_for(lambda: 'showing "arm" (2 links) in /r1/left' in node.output, "one robot")
        wait_for(lambda: 'showing "leg" (2 links) in /right' in node.output, "the other")
        wait_for(
            lambda: "no description yet of the robots in /r1/later" in node.output, "the third"
        )
        alike.move()
        other.move()
        for entity in ("/r1/left/joints/position/0", "/right/joints/position/0"):
            wait_for(lambda: while_written(chunks, file, entity), entity)  # noqa: B023
        size = file.stat().st_size
        resource.prlimit(node.process.pid, resource.RLIMIT_FSIZE, (size, size))
        wait_for(lambda: alike.move() or node.process.poll() is not None, "the end")
        assert node.wait() == 1
        limit = f"error: save:={file}: {os.strerror(errno.EFBIG)}"
        assert lines_of_ours(node.output)[-1] == limit
        for word in ("Traceback", "Error occurred", "ERROR", "FATAL"):
            assert word not in node.output


def test_no_process_outlives_the_node(ros_domain, tmp_path):
    """Whatever ends it, its page's server ends, too."""
    with viewer_node(tmp_path, viewer="web", check=False) as node:
        _page(node)
        children = psutil.Process(node.process.pid).children(recursive=True)
        assert children
        node.process.kill()
        assert node.wait() == -signal.SIGKILL
        wait_for(lambda: not any(child.is_running() for child in children), "its children's end")


def test_nothing_to_show_is_said(start_node, capfd):
    """With viewer:=none and no file the node lives on, so that a launch file need not differ."""
    start_node(RerunViewer, viewer="none")
    assert "nothing will be shown" in capfd.readouterr().err


def test_the_page_s_address_is_published(shown):
    """Latched, once the page is up: it names the page and the recording's server."""
    for _ in range(2):  # the second subscriber comes later
        pages = shown.peer.hear(String, f"{NODE}/page", LATCHED)
        address = wait_for(lambda: pages[-1].data, "the address")  # noqa: B023
        assert address.startswith("http://127.0.0.1:") and "url=rerun%2Bhttp" in address
    assert f"open {address.partition('/?')[0]}" in shown.node.output


def test_the_page_around_the_view_says_which_pictures_it_shows(ros_domain: int) -> None:
    """As long as it is there; a message that is none names none."""
    with Peer(ros_domain, "rerun_viewer") as viewer, Peer(ros_domain, "page") as page:
        cameras = PageCameras(viewer.node)
        assert cameras.topics is None
        publisher = page.publisher(String, f"{NODE}/page_cameras", LATCHED)
        wait_for(lambda: cameras.topics == frozenset(), "the page")
        for text, topics in (('{"cameras": ["/a", "/b"]}', {"/a", "/b"}), ("[]", set())):
            publisher.publish(String(data=text))
            wait_for(lambda topics=topics: cameras.topics == topics, text)
        page.run(page.node.destroy_publisher, publisher)
        wait_for(lambda: cameras.topics is None, "its end")


# --- the view: switched, edited and saved while it runs -------------------------------------------


def test_a_switch_is_saved(shown):
    """RViz's check boxes, to any file; what cannot be is refused with what would be right."""
    view, peer = shown.folder / "view.yaml", shown.peer
    [refused] = peer.set_parameters(NODE, **{"camera.eye": [1.0]})
    assert not refused.successful
    assert "camera.eye: 1 numbers" in refused.reason
    for collision in (True, False):
        results = peer.set_parameters(NODE, collision=collision, **{"camera.eye": [4, 0, 0]})
        assert all(result.successful for result in results)
        answer = peer.call(Trigger, f"{NODE}/save_view")
        assert answer.success and str(view) in answer.message
        saved = load_view(view)
        assert saved.collision is collision and saved.camera.eye == (4.0, 0.0, 0.0)
    for name, success in (("x.txt", False), ("copy.yaml", True)):
        peer.set_parameters(NODE, save_view_to=str(view.with_name(name)))
        assert peer.call(Trigger, f"{NODE}/save_view").success is success
        assert view.with_name(name).exists() is success
    peer.set_parameters(NODE, save_view_to="")


def test_an_edit_of_the_file_is_shown_and_a_mistake_is_said_once(shown):
    """The last good view stays; the parameters follow; new topics are heard."""
    view, node, peer = shown.folder / "view.yaml", shown.node, shown.peer
    view.write_text(VIEW)
    wait_for(
        lambda: list(peer.parameter(NODE, "camera.eye")) == [2.6, 0.5, 0.0], "the view at first"
    )
    before = len(node.output)
    view.write_text(VIEW + "collision: maybe\n")
    wait_for(lambda: "keeping the view shown so far" in node.output[before:], "the warning")
    assert peer.parameter(NODE, "collision") is False
    view.write_text(VIEW + "collision: true\ntrails: {way: {topic: way}}\n")
    wait_for(lambda: "the view is up to date" in node.output[before:], "the edit")
    assert peer.parameter(NODE, "collision") is True
    wait_for(lambda: peer.node.count_subscribers("/way") == 1, "the new topic")
    view.write_text(VIEW + "trails: {way: {topic: other}}\n")
    wait_for(lambda: peer.node.count_subscribers("/other") == 1, "the other topic")
    wait_for(lambda: peer.node.count_subscribers("/way") == 0, "the end of the first")
    assert node.output[before:].count("keeping the view") == 1


def test_without_a_file_the_view_is_the_robot_s_own(start_node, peer, tmp_path):
    """Found by its name."""
    node = start_node(RerunViewer, viewer="none", save=tmp_path / "x.rrd")
    description = peer.node.create_publisher(String, "robot_description", LATCHED)
    description.publish(String(data=ARM.replace('name="arm"', 'name="mrm"')))
    spin_until(node, lambda: node.get_parameter("joint_plot.limits").value, "MRM's view")


def test_a_refused_view_leaves_the_recording_that_it_would_replace(start_node, tmp_path):
    """Though only what is shown, with the recording open, finds the mistake."""
    file, view = tmp_path / "x.rrd", tmp_path / "view.yaml"
    file.write_text("the last recording")
    view.write_text("trails: {t: {topic: joint_states}}")
    with pytest.raises(OneBotError, match="cannot be subscribed as"):
        start_node(RerunViewer, viewer="none", save=file, view=view)
    assert file.read_text() == "the last recording"


def test_a_parameter_given_at_the_start_overrides_the_file(start_node, tmp_path):
    """But not the empty fixed_frame that a launch file passes on."""
    file = tmp_path / "view.yaml"
    file.write_text(VIEW)
    given = {"view": file, "axes.visible": True, "fixed_frame": '""'}
    node = start_node(lambda: Node("rerun_viewer"), **given)
    own = read(ViewerParameters, declare(node, ViewerParameters))
    live = LiveView(node, own, apply=lambda: None)
    assert node.get_parameter("axes.visible").value is True
    assert node.get_parameter("fixed_frame").value == "base"
    assert list(node.get_parameter("camera.eye").value) == [2.6, 0.5, 0.0]
    live.source.save()
    assert load_view(file).axes.visible
