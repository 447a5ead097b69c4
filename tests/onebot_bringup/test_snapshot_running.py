"""``onebot snapshot`` of a running robot, heard over real DDS."""

from pathlib import Path

import numpy as np
import pytest
from sensor_msgs.msg import JointState

from onebot_description.elements.packages import use_environment_prefix
from tests.onebot_bringup.cli_support import onebot
from tests.onebot_bringup.test_snapshot_pictures import drawn
from tests.onebot_bringup.viewer_support import ARM, BLUE, ORANGE, VIEW
from tests.ros_support import NodeProcess, Peer, ros_args
from tests.support import wait_for
from tests.support_rendering import colored, require_renderer

pytestmark = pytest.mark.slow

PUBLISHER = "onebot_description.robot_state_publisher"


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    require_renderer()
    use_environment_prefix()
    (tmp_path / "view.yaml").write_text(VIEW)
    (tmp_path / "arm.urdf").write_text(ARM)
    return tmp_path


def publish_joint(peer: Peer, position: float) -> None:
    """Publish where the joint stands, some times a second from now on."""
    message = JointState(name=["slide"], position=[position])
    message.header.stamp = peer.node.get_clock().now().to_msg()
    publisher = peer.publisher(JointState, "joint_states")
    peer.node.create_timer(0.05, lambda: publisher.publish(message))


def test_it_looks_as_its_description_does_at_these_positions(arm, ros_domain):
    """A picture of the running robot at rest, and one without ROS, are equal to the byte."""
    view = ("--view", arm / "view.yaml")
    posed = drawn(arm, arm / "arm.urdf", *view, "--joints", "slide=0.75", name="posed.png")
    assert colored(posed, ORANGE).any() and colored(posed, BLUE).any()
    # The stamp stays the same, as of a robot that was heard once: it is published all the same.
    # The prefix of its frames is what its publisher has.
    parameters = ros_args(ignore_timestamp=True, frame_prefix="left/")
    with NodeProcess(PUBLISHER, str(arm / "arm.urdf"), *parameters):
        with Peer(ros_domain) as peer:
            publish_joint(peer, 0.75)
            np.testing.assert_array_equal(drawn(arm, *view, name="live.png"), posed)


def test_what_is_missing_is_named(arm, ros_domain):
    """No robot at all; none in this namespace; no joint states."""
    words = ("snapshot", str(arm / "a.png"))
    done = onebot(*words)
    assert done.returncode == 1 and "nothing on /robot_description (elsewhere: none)" in done.stderr
    prefixed = ros_args(frame_prefix="left/", ignore_timestamp=True)
    node = NodeProcess(PUBLISHER, str(arm / "arm.urdf"), *prefixed, "-r", "__ns:=/left")
    with node, Peer(ros_domain) as peer:
        wait_for(lambda: peer.node.count_publishers("/left/robot_description"), "the publisher")
        done = onebot(*words, "--ros-args", "-r", "__ns:=/right")
        assert done.returncode == 1
        assert "elsewhere: /left/robot_description" in done.stderr, done.stderr
        done = onebot(*words)
        assert done.returncode == 1 and "waiting for the frames of left/tip" in done.stderr
        assert "within 6 s (frames received: " in done.stderr
    assert not (arm / "a.png").exists()
