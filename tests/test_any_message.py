"""No message of any content ends a node, and no number that is not finite leaves one."""

import json
import re
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import rclpy
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rclpy.node import Node

from onebot_bringup.bags.bag_recorder import BagRecorder
from onebot_bringup.introspection.interfaces import message_class
from onebot_bringup.introspection.message_text import to_csv
from onebot_bringup.steering.steering_page import SteeringPage
from onebot_bringup.viewer.rerun_viewer import RerunViewer
from onebot_control.parameters import default_control_file
from onebot_control.velocity_controller import VelocityController
from onebot_description.description import load_description
from onebot_description.joint_state_publisher import JointStatePublisher
from onebot_description.node import RosArguments
from onebot_description.robot_state_publisher import RobotStatePublisher
from tests.any_message import broken, messages, received, serialized
from tests.ros_support import ros_args
from tests.support import wait_for

ONEBOT = Path("onebot_description/urdf/onebot.urdf.xacro")
NAMES = ("left_wheel_joint", "right_wheel_joint", "base_link", "left_wheel", "odom", "world")
any_content = settings(max_examples=100, suppress_health_check=list(HealthCheck))


@pytest.fixture
def start(ros_domain: int) -> Iterator[Callable[..., Node]]:
    """Makes a node with these parameters set on its command line."""
    nodes: list[Node] = []

    def make(build: Callable[[], Node], **parameters: Any) -> Node:
        rclpy.init(args=ros_args(**parameters))
        nodes.append(build())
        return nodes[0]

    yield make
    for node in nodes:
        node.destroy_node()
    rclpy.try_shutdown()


class Published:
    """Looks at all that a node publishes, as it does."""

    def __init__(self, node: Node) -> None:
        self.not_finite: list[str] = []
        for publisher in node.publishers:
            publisher.publish = partial(self._look, publisher, publisher.publish)

    def _look(self, publisher: Any, publish: Callable[[Any], None], message: Any) -> None:
        if isinstance(message, bytes):
            shown = to_csv(rclpy.serialization.deserialize_message(message, publisher.msg_type))
        else:
            shown = to_csv(message)
        if re.search(r"(^|,)-?(nan|inf)(,|$)", shown):
            self.not_finite.append(f"{publisher.topic_name}: {shown}")
        publish(message)


def feed(node: Node, check: Callable[[], None], topics: tuple[str, ...] = ()) -> None:
    """Give a node messages of any content on ``topics`` (by default all that it subscribes to).

    Args:
        node: the node.
        check: called after each message.
        topics: parts of their names.
    """
    chosen = [
        one
        for one in node.subscriptions
        if not topics or any(name in one.topic_name for name in topics)
    ]
    assert chosen

    @any_content
    @given(st.data())
    def any_messages(data: st.DataObject) -> None:
        subscription = data.draw(st.sampled_from(chosen))
        message = serialized(data.draw(messages(subscription.msg_type, NAMES)))
        received(subscription, broken(data.draw, message))
        check()

    any_messages()


def test_robot_state_publisher(start: Callable[..., Node]) -> None:
    """Bytes of any kind; it also gives transforms afterwards."""
    node = start(lambda: RobotStatePublisher(load_description(ONEBOT)))
    published = Published(node)
    feed(node, lambda: None)
    assert published.not_finite == []


def test_joint_state_publisher(start: Callable[..., Node]) -> None:
    """What it receives, and what it publishes after it."""
    node = start(
        lambda: JointStatePublisher(None, RosArguments(names=(("", "robot_description"),))),
        source_list="[others]",
    )
    description = load_description(ONEBOT).urdf
    published = Published(node)
    for subscription in node.subscriptions:
        if "robot_description" in subscription.topic_name:
            subscription.callback(message_class("std_msgs/msg/String")(data=description))
    feed(node, node._output.publish)
    assert published.not_finite == []


@pytest.mark.parametrize("kind", ["Twist", "TwistStamped"])
@pytest.mark.parametrize("limited", [True, False])
def test_velocity_controller(start: Callable[..., Node], kind: str, limited: bool) -> None:
    """Commands, poses and descriptions, also without any limit; then the robot still drives."""
    wheels = "left_wheel_names:=[left_wheel_joint]", "right_wheel_names:=[right_wheel_joint]"
    urdf = load_description(ONEBOT).urdf
    if not limited:
        urdf = re.sub(r'velocity="[^"]*"', 'velocity="1e300"', urdf)
    node = start(
        lambda: VelocityController(None, RosArguments((default_control_file(),) * limited)),
        robot_description=json.dumps(urdf),
        cmd_vel_type=kind,
        **({} if limited else dict(word.split(":=") for word in wheels)),
    )
    published = Published(node)

    def alive() -> None:
        assert node._driving._failure is None

    feed(node, alive, ("cmd_vel", "teleport", "set_odometry", "description"))
    ticks = node._driving._loop.robot.ticks
    wait_for(
        lambda: node._driving._failure or node._driving._loop.robot.ticks > ticks + 10, "cycles"
    )
    alive()
    assert published.not_finite == []


def test_rerun_viewer(start: Callable[..., Node], tmp_path: Path) -> None:
    """All displays."""
    node = start(
        RerunViewer,
        viewer="none",
        save=tmp_path / "x.rrd",
        view="onebot_description/config/view.yaml",
    )
    view = node._view
    description = message_class("std_msgs/msg/String")(data=load_description(ONEBOT).urdf)
    view.take("/robot_description", "std_msgs/msg/String", serialized(description), 1)
    node._tick()
    assert view.robot is not None
    chosen = [(name, kind.name) for name, topic in view.topics.items() for kind in topic.types]
    assert {kind for _, kind in chosen} >= {"nav_msgs/msg/Path", "nav_msgs/msg/Odometry"}

    @any_content
    @given(st.data())
    def any_messages(data: st.DataObject) -> None:
        for _ in range(data.draw(st.integers(1, 4))):
            topic, kind = data.draw(st.sampled_from(chosen))
            message = serialized(data.draw(messages(message_class(kind), NAMES)))
            view.take(topic, kind, broken(data.draw, message), data.draw(st.integers(0, 2**62)))
        node._tick()

    any_messages()


def test_steering_page(start: Callable[..., Node]) -> None:
    """Odometry that is shown, and the address of a view."""
    node = start(SteeringPage, port=0, open_browser="false", odom_topic="/odom")
    node._poll_graph()
    feed(node, lambda: node._robot())


def test_bag_recorder(start: Callable[..., Node], tmp_path: Path) -> None:
    """They are recorded as they come, without being looked at."""
    node = start(BagRecorder, folder=tmp_path / "run")
    feed(node, node._write)
    assert node._bag.open
