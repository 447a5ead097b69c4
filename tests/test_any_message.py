"""No message of any content ends a node, and no number that is not finite leaves one."""

import json
import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from nav_msgs.msg import Path as PathMessage
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rosidl_runtime_py import message_to_csv, message_to_yaml
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from yarl import URL

from onebot_bringup.bags.bag_recorder import BagRecorder
from onebot_bringup.introspection.interfaces import message_class
from onebot_bringup.steering.steering_page import SteeringPage
from onebot_bringup.viewer.displays import DRAWING_BY_TYPE
from onebot_bringup.viewer.rerun_viewer import RerunViewer
from onebot_control.drive_kinds import ControlConfig
from onebot_control.velocity_controller import simulation_nodes
from onebot_description.description import load_description, parse_description
from onebot_description.joint_state_publisher import JointStatePublisher
from onebot_description.robot_state_publisher import RobotStatePublisher
from onebot_description.ros.command_line import RosArguments
from onebot_description.ros.wire.interface_text import installed_interfaces
from onebot_description.ros.wire.interfaces import TFMessage
from tests.any_message import broken, messages, received, serialized
from tests.support import wait_for

ONEBOT = Path("onebot_description/urdf/onebot.urdf.xacro")
NAMES = ("left_wheel_joint", "right_wheel_joint", "base_link", "left_wheel", "odom", "world")
EXAMPLES = 20  # others in each run
any_content = settings(max_examples=EXAMPLES, suppress_health_check=list(HealthCheck))


class Published:
    """Looks at all that a node publishes, as it does."""

    def __init__(self, node: Node) -> None:
        self.count, self.not_finite = 0, list[str]()
        for publisher in node.publishers:
            publisher.publish = partial(self._look, publisher, publisher.publish)

    def _look(self, publisher: Any, publish: Callable[[Any], None], message: Any) -> None:
        if isinstance(message, bytes):
            message = deserialize_message(message, publisher.msg_type)
        self.count += 1
        shown = message_to_csv(message, truncate_length=128)
        if re.search(r"(^|,)-?(nan|inf)(,|$)", shown):
            self.not_finite.append(f"{publisher.topic_name}: {shown}")
        publish(message)


def feed(
    node: Node,
    check: Callable[[], object],
    topics: Sequence[str] = (),
    names: Sequence[str] = NAMES,
    examples: int = EXAMPLES,
) -> None:
    """Give a node messages of any content on ``topics`` (by default all that it subscribes to).

    Args:
        node: the node.
        check: called after each message.
        topics: parts of their names.
        names: that strings often are.
        examples: how many messages.
    """
    chosen = [
        one
        for one in node.subscriptions
        if not topics or any(name in one.topic_name for name in topics)
    ]
    assert chosen

    @settings(any_content, max_examples=examples)
    @given(st.data())
    def any_messages(data: st.DataObject) -> None:
        subscription = data.draw(st.sampled_from(chosen))
        message = serialized(data.draw(messages(subscription.msg_type, names)))
        received(subscription, broken(data.draw, message))
        check()

    any_messages()


# A joint that follows another one ten times as far.
ARM = """<robot name="arm"><link name="base"/><link name="a"/><link name="b"/>
  <joint name="lead" type="prismatic"><parent link="base"/><child link="a"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="follow" type="prismatic"><parent link="a"/><child link="b"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
    <mimic joint="lead" multiplier="10"/></joint>
</robot>"""


def test_robot_state_publisher(start_node: Callable[..., Node]) -> None:
    """Bytes of any kind; the next good message is published, whatever the stamps before it were."""
    node = start_node(lambda: RobotStatePublisher(parse_description(ARM)))
    published = Published(node)
    feed(node, lambda: None, names=("lead", "follow"), examples=40)
    for second in (100, 200):
        state = JointState(name=["lead"], position=[0.5])
        state.header.stamp.sec = second
        published.count = 0
        node._on_joint_state(serialized(state))
    assert published.count == 1
    assert published.not_finite == []


def test_joint_state_publisher(start_node: Callable[..., Node]) -> None:
    """What it receives, and what it publishes after it."""
    node = start_node(
        lambda: JointStatePublisher(None, RosArguments(names=(("", "robot_description"),))),
        source_list="[others]",
    )
    published = Published(node)
    for subscription in node.subscriptions:
        if "robot_description" in subscription.topic_name:
            subscription.callback(String(data=ARM))
    published.count = 0
    feed(node, node._output.publish, names=("lead", "follow"), examples=30)
    assert published.count > 0
    assert published.not_finite == []


@pytest.mark.parametrize("kind", ["Twist", "TwistStamped"])
def test_velocity_controller(start_node: Callable[..., Node], kind: str) -> None:
    """Commands, poses and descriptions, without any limit; then the robot still drives."""
    urdf = re.sub(r'velocity="[^"]*"', 'velocity="1e300"', load_description(ONEBOT).urdf)
    node = start_node(
        lambda: simulation_nodes("velocity_controller", ControlConfig)[0],
        robot_description=json.dumps(urdf),
        left_wheel_names="[left_wheel_joint]",
        right_wheel_names="[right_wheel_joint]",
    )
    published, interface = Published(node), node.interface
    commands = interface.robots[0].commands.subscription
    commands._wanted = f"geometry_msgs/msg/{kind}"
    for _ in range(2):
        commands.follow()

    def driven() -> None:
        # The control loop takes the message before the next one comes.
        interface.loop.call(lambda: None)
        assert interface._failure is None

    feed(node, driven, ("teleport", "description"))
    feed(node, driven, ("cmd_vel",), examples=30)
    ticks = interface.loop.fleet.ticks
    wait_for(
        lambda: interface._failure or interface.loop.fleet.ticks > ticks + 10, "control cycles"
    )
    assert interface._failure is None
    assert published.not_finite == []


@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_rerun_viewer(start_node: Callable[..., Node], tmp_path: Path) -> None:
    """All displays, without a warning of numpy's in the node's output."""
    types = sorted(DRAWING_BY_TYPE.keys() & set(installed_interfaces("msg")))
    offered = {f"/any{number}": kind for number, kind in enumerate(types)}
    node = start_node(
        RerunViewer,
        viewer="none",
        save=tmp_path / "x.rrd",
        view="onebot_description/config/view.yaml",
        shown=list(offered),
    )
    view = node._view
    description = message_class("std_msgs/msg/String")(data=load_description(ONEBOT).urdf)
    view.take("/robot_description", "std_msgs/msg/String", serialized(description), 1)
    node._tick()
    assert view.robot is not None
    assert view.offer(offered) == []
    chosen = [
        (name, kind.name)
        for name, topic in view.topics.items()
        for kind in topic.types
        if kind.name in installed_interfaces("msg")
    ]
    assert {kind for _, kind in chosen} >= {*types, "tf2_msgs/msg/TFMessage"}

    @any_content
    @given(st.data())
    def any_messages(data: st.DataObject) -> None:
        for _ in range(data.draw(st.integers(1, 4))):
            topic, kind = data.draw(st.sampled_from(chosen))
            message = serialized(data.draw(messages(message_class(kind), NAMES)))
            view.take(topic, kind, broken(data.draw, message), data.draw(st.integers(0, 2**62)))
        node._tick()

    any_messages()


def test_steering_page(start_node: Callable[..., Node]) -> None:
    """Odometry and the address of a view, which the page shows as JSON and as a link."""
    node = start_node(SteeringPage, port=0, open_browser="false", odom_topic="/odom")
    node._poll_graph()

    def shown() -> None:
        json.dumps(dict(node._robot()), allow_nan=False)
        if node._viewer.view is not None:
            addresses = node._viewer.view.addresses("127.0.0.1:8080")
            assert all(URL(each).path.startswith("/view/") for each in addresses)

    page = "http://127.0.0.1:9090/?url=rerun%2Bhttp://127.0.0.1:9876/proxy"
    feed(node, shown, names=(page, f"{page}&x=%\x01\xe9"))


@pytest.mark.parametrize("kind", [JointState, TFMessage, Odometry, PathMessage, String])
def test_text(kind: Any) -> None:
    """As ``onebot topic echo`` prints it."""

    @any_content
    @given(messages(kind, NAMES))
    def any_messages(message: Any) -> None:
        message = deserialize_message(serialized(message), kind)
        for options in ({"truncate_length": 9}, {}, {"no_arr": True}):
            assert message_to_yaml(message, flow_style=not options, **options).encode()
            assert isinstance(message_to_csv(message, **options).encode(), bytes)
        assert list(yaml.safe_load(message_to_yaml(message))) == list(
            kind.get_fields_and_field_types()
        )

    any_messages()


def test_bag_recorder(start_node: Callable[..., Node], tmp_path: Path) -> None:
    """They are recorded as they come, without being looked at."""
    node = start_node(BagRecorder, folder=tmp_path / "run")
    node.create_publisher(JointState, "joint_states", 10)
    wait_for(lambda: node._poll() or any(node.subscriptions), "a subscription")
    feed(node, node._write)
    assert node._bag.open
