"""robot_state_publisher on real DDS, heard from another process."""

import itertools
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from builtin_interfaces.msg import Time
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String

from onebot_description.description import parse_description
from onebot_description.robot_state_publisher import RobotStatePublisher
from onebot_description.ros.domains import used_domain
from onebot_description.ros.wire.interfaces import TFMessage
from tests.ros_support import LATCHED, NodeProcess, Peer, refusals, ros_args
from tests.support import wait_for

MODULE = "onebot_description.robot_state_publisher"
ARM = """<robot name="arm">
  <link name="base"/><link name="plate"/><link name="link1"/>
  <joint name="mount" type="fixed">
    <parent link="base"/><child link="plate"/><origin xyz="{x} 0 0"/>
  </joint>
  <joint name="turn" type="revolute">
    <parent link="plate"/><child link="link1"/><origin xyz="0 0 0.5"/><axis xyz="0 0 1"/>
    <limit lower="-3" upper="3" effort="1" velocity="1"/>
  </joint>
</robot>"""


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM.format(x=5))
    return path


class Running(NamedTuple):
    """A node that publishes the arm of a file, and who hears it."""

    node: NodeProcess
    peer: Peer
    file: Path
    domain: int


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    """One node for the tests that leave it as it was: with the arm at 5 m."""
    file = tmp_path_factory.mktemp("arm") / "arm.urdf"
    file.write_text(ARM.format(x=5))
    with used_domain() as domain, NodeProcess(MODULE, str(file)) as node, Peer(domain) as peer:
        yield Running(node, peer, file, domain)


def _state(position, seconds=100, names=("turn",)):
    header = Header(stamp=Time(sec=seconds))
    return JointState(header=header, name=list(names), position=[position] * len(names))


def test_late_joiner_gets_description_and_static_and_moving_transforms(running):
    early = running.peer.hear(String, "robot_description", LATCHED)
    wait_for(lambda: early, "the description")
    with Peer(running.domain, "late") as peer:
        described = peer.hear(String, "robot_description", LATCHED)
        static = peer.hear(TFMessage, "/tf_static", LATCHED)
        moving = peer.hear(TFMessage, "/tf")
        wait_for(lambda: described and static, "the latched topics")
        assert 'name="turn"' in described[0].data
        [fixed] = static[0].transforms
        assert (fixed.header.frame_id, fixed.child_frame_id) == ("base", "plate")
        assert fixed.transform.translation.x == 5.0
        assert fixed.header.stamp.sec > 1_600_000_000
        publisher = peer.publisher(JointState, "joint_states", qos_profile_sensor_data)
        wait_for(lambda: peer.node.count_publishers("/tf"), "the publisher of /tf")
        _send_until(publisher, moving, 1.0)
        [edge] = moving[0].transforms
        assert (edge.header.frame_id, edge.child_frame_id) == ("plate", "link1")
        assert edge.header.stamp == Time(sec=100)
        assert edge.transform.translation.z == 0.5
        assert edge.transform.rotation.z == pytest.approx(math.sin(0.5), abs=1e-15)
        assert edge.transform.rotation.w == pytest.approx(math.cos(0.5), abs=1e-15)


def _send_until(publisher, heard, position, seconds=100):
    """Send (best effort may lose the first) until something is heard."""
    wait_for(lambda: publisher.publish(_state(position, seconds)) or heard, "a transform")


def _change(peer, **values):
    """Set a parameter; return the reason of a refusal, empty if it was set."""
    [result] = peer.set_parameters("robot_state_publisher", **values)
    assert result.successful == (not result.reason)
    return result.reason


def test_live_changes_take_effect_or_are_rejected_with_the_reason(ros_domain, arm):
    with NodeProcess(MODULE, str(arm)) as node, Peer(ros_domain) as peer:
        static = peer.hear(TFMessage, "/tf_static", LATCHED)
        described = peer.hear(String, "robot_description", LATCHED)
        moving = peer.hear(TFMessage, "/tf")
        wait_for(lambda: static, "/tf_static")

        assert _change(peer, robot_description=ARM.format(x=10)) == ""
        wait_for(lambda: static[-1].transforms[0].transform.translation.x == 10.0, "x = 10")
        wait_for(lambda: 'xyz="10' in described[-1].data, "the new description")

        assert _change(peer, publish_frequency=500) == ""
        assert _change(peer, frame_prefix="my_prefix/") == ""
        wait_for(lambda: static[-1].transforms[0].child_frame_id == "my_prefix/plate", "the prefix")
        publisher = peer.publisher(JointState, "joint_states", qos_profile_sensor_data)
        moving.clear()
        _send_until(publisher, moving, 0.5)
        assert moving[-1].transforms[0].header.frame_id == "my_prefix/plate"

        count = len(static)
        broken = ARM.format(x=1).replace('child link="link1"', 'child link="linc1"')
        fixed = ARM.format(x=1).replace('name="turn" type="revolute"', 'name="turn" type="fixed"')
        loose = fixed.replace("</robot>", '<link name="lost"/></robot>')
        for change, words in (
            ({"robot_description": broken}, "linc1"),
            ({"robot_description": ""}, "empty"),
            ({"robot_description": loose}, "is in 2 separate parts"),
            ({"frame_prefix": 5}, "frame_prefix: 5 is a number; write a string"),
            ({"publish_frequency": 2000.0}, "range"),
        ):
            assert words in _change(peer, **change)
        moving.clear()
        _send_until(publisher, moving, 0.25, 200)
        assert moving[-1].transforms[0].header.frame_id == "my_prefix/plate"
        assert len(static) == count

        # As in the standard node's own test of a live change.
        assert _change(peer, robot_description=fixed) == ""
        wait_for(lambda: len(static[-1].transforms) == 2, "the joint that is fixed now")
        floating = fixed.replace('name="turn" type="fixed"', 'name="turn" type="floating"')
        assert _change(peer, robot_description=floating) == ""
        wait_for(lambda: len(static[-1].transforms) == 1, "the joint that floats now")
        wait_for(lambda: "has to publish that of link1" in node.output, "the warning")
        assert _change(peer, hold_floating_joints=True) == ""
        wait_for(lambda: len(static[-1].transforms) == 2, "the joint that is held now")


def test_an_edited_file_is_published(running):
    static = running.peer.hear(TFMessage, "/tf_static", LATCHED)
    wait_for(lambda: static, "/tf_static")
    running.file.write_text(ARM.format(x=6).replace("</robot>", ""))
    wait_for(lambda: "stays as it was until this is fixed" in running.node.output, "the report")
    assert len(static) == 1
    for x in (6.0, 5.0):
        running.file.write_text(ARM.format(x=x))
        wait_for(lambda: static[-1].transforms[0].transform.translation.x == x, "it")  # noqa: B023


def test_a_namespace_and_a_publish_frequency(start_node: Callable[..., Any]):
    """The topics but /tf are in the namespace, and the throttle goes by the stamps."""
    robot = parse_description(ARM.format(x=5))
    build = lambda: RobotStatePublisher(robot, ["-r", "__ns:=/left"])  # noqa: E731
    node = start_node(build, publish_frequency=1.0)
    topics = {name for name, _ in node.get_topic_names_and_types()}
    assert topics >= {"/tf", "/left/robot_description", "/left/joint_states"}
    published: list[bytes] = []
    node._tf.publish = published.append
    for quarter in range(9):
        message = _state(0.0)
        message.header.stamp = Time(sec=100 + quarter // 4, nanosec=quarter % 4 * 250_000_000)
        node._on_joint_state(serialize_message(message))
    edges = [deserialize_message(data, TFMessage).transforms[0] for data in published]
    assert [edge.header.stamp for edge in edges] == [Time(sec=100 + n) for n in range(3)]


def test_bad_messages_leave_it_running(running):
    node, peer = running.node, running.peer
    moving = peer.hear(TFMessage, "/tf")
    publisher = peer.publisher(JointState, "joint_states", qos_profile_sensor_data)
    bad = b"\x00\x01\x00\x00\xff\xff\xff\xff"
    # Best effort may lose some.
    wait_for(lambda: publisher.publish(bad) or "cannot be read" in node.output, "the warning")
    publisher.publish(_state(1.0, names=("unknown",)))
    assert not moving
    _send_until(publisher, moving, 0.5, 200)
    assert moving[0].transforms[0].child_frame_id == "link1"


def test_user_mistakes_give_one_clear_error(ros_domain):
    mistakes = [
        ([], ["robot_description is empty", "URDF or xacro file"]),
        (ros_args(use_sim_time=5), ["use_sim_time", "expecting type 'BOOL'"]),
    ]
    outputs = refusals(MODULE, [args for args, _ in mistakes])
    for output, (_, fragments) in zip(outputs, mistakes, strict=True):
        assert all(fragment in output for fragment in fragments), output


def test_ctrl_c_while_busy(ros_domain, arm):
    with NodeProcess(MODULE, str(arm)) as node, Peer(ros_domain) as peer:
        moving = peer.hear(TFMessage, "/tf")
        publisher = peer.publisher(JointState, "joint_states", qos_profile_sensor_data)
        seconds = itertools.count(1)
        pour = lambda: publisher.publish(_state(0.1, next(seconds)))  # noqa: E731
        peer.node.create_timer(1e-4, pour)
        wait_for(lambda: len(moving) > 100, "many transforms")
        assert node.interrupt() == 0


def test_a_second_publisher_of_the_description_is_warned_of(ros_domain, arm):
    with Peer(ros_domain) as peer, NodeProcess(MODULE, str(arm), check=False) as killed:
        wait_for(lambda: peer.node.count_publishers("robot_description") == 1, "the first")
        killed.process.kill()
        with NodeProcess(MODULE, str(arm)) as one, NodeProcess(MODULE, str(arm)) as other:
            warning = "/robot_state_publisher: nodes see two robots as one"
            for node in (one, other):
                wait_for(lambda node=node: warning in node.output, "the warning")
                assert "namespace:=" in node.output and "domain_id:=" in node.output
            assert [node.output.count("has several publishers") for node in (one, other)] == [1, 1]
