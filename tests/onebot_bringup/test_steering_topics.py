"""The steering page follows what is on the ROS graph: types, topics, limits, odometry, views."""

import math
from collections.abc import Iterator
from typing import Any

import pytest
import rclpy
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import GetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from onebot_bringup.steering.protocol import Velocity
from onebot_bringup.steering.steering_page import CommandSubscriber, ControllerLimits
from tests.onebot_bringup.steering_support import (
    TOPIC,
    Commands,
    PageClient,
    address_of,
    steered,
)
from tests.ros_support import LATCHED, Peer
from tests.support import wait_for

STAMPED = "geometry_msgs/msg/TwistStamped"
LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.fixture
def peer(ros_domain: int) -> Iterator[Peer]:
    with Peer(ros_domain) as peer:
        yield peer


def _waited(page: PageClient, key: str, value: Any) -> None:
    wait_for(lambda: page.state[key] == value, f"{key} to be {value}; it is {page.state[key]}")


def test_a_robot_that_takes_stamped_commands_gets_them(peer):
    """The type is the listeners'; the stamp is now."""
    with steered() as (_, page):
        robot = Commands(peer, page, kind=TwistStamped)
        _waited(page, "topic_type", STAMPED)
        page.hold(0.3)
        robot.reach(0.3)
        stamp = robot.heard[-1].header.stamp
        now = peer.node.get_clock().now().nanoseconds * 1e-9
        assert abs(now - (stamp.sec + stamp.nanosec * 1e-9)) < 60.0
        page.let_go()
        robot.come_to_rest()


def test_the_type_is_followed_live(peer, ros_domain):
    """A robot that comes back with the other type is driven again."""
    with steered() as (node, page):
        first: list[Any] = []
        subscription = peer.node.create_subscription(Twist, TOPIC, first.append, 10)
        _waited(page, "listeners", 1)
        page.hold(0.3)
        wait_for(lambda: first, "a Twist")
        page.let_go()
        peer.node.destroy_subscription(subscription)
        _waited(page, "listeners", 0)
    with steered() as (node, page):
        wait_for(lambda: not peer.node.get_publishers_info_by_topic(TOPIC), "the node to be gone")
        with Peer(ros_domain, "rerun_viewer") as viewer:
            # A viewer that hears Twist is no robot: it must not hold the type.
            viewer.hear(Twist, TOPIC, LATEST)
            page.hold(0.3)
            wait_for(lambda: peer.node.count_publishers(TOPIC), "a publisher")
            page.let_go()
        robot = Commands(peer, page, kind=TwistStamped)
        _waited(page, "topic_type", STAMPED)
        page.hold(0.2)
        robot.reach(0.2)


def test_another_topic_is_steered_after_the_old_robot_was_stopped(peer):
    """The old one gets zeros, the new one nothing before somebody takes hold anew."""
    with steered() as (_, page):
        first = Commands(peer, page)
        second = peer.hear(TwistStamped, "/other/cmd_vel")
        wait_for(
            lambda: {TOPIC, "/other/cmd_vel"} <= set(page.state["topics"]), "both topics offered"
        )
        page.hold(0.3)
        first.reach(0.3)
        page.send("topic", topic="/other/cmd_vel")
        _waited(page, "topic", "/other/cmd_vel")
        _waited(page, "topic_type", STAMPED)
        first.come_to_rest()
        assert page.state["driver"] is None and second == []
        page.let_go()
        page.hold(0.1)
        wait_for(lambda: second, "commands on the new topic")
        assert {message.twist.linear.x for message in second} == {0.1}
        count = len(first.heard)
        page.send("topic", topic="/nobody/here")
        _waited(page, "topic", "/nobody/here")
        assert page.state["listeners"] == 0
        wait_for(lambda: second[-1].twist.linear.x == 0.0, "the second robot to be stopped")
        assert len(first.heard) == count


def _holds_twist(peer: Peer, topic: str) -> bool:
    ends = peer.node.get_publishers_info_by_topic(topic)
    return any(end.topic_type.startswith("geometry_msgs/msg/Twist") for end in ends)


def test_a_topic_of_another_type_is_refused(peer):
    """With a sentence, to the page that wanted it only; what is steered goes on."""
    texts = peer.hear(String, "/texts")
    with steered(2) as (_, page, other):
        robot = Commands(peer, page)
        page.hold(0.3)
        robot.reach(0.3)
        for topic, kind in {
            "/texts": "std_msgs/msg/String",
            "/rosout": "rcl_interfaces/msg/Log",
        }.items():
            page.send("topic", topic=topic)
            sentence = f"{topic} has the type {kind}, not Twist or TwistStamped: choose another."
            wait_for(lambda sentence=sentence: sentence in page.errors, "the refusal")
            assert page.state["topic"] == TOPIC and page.state["you"]
            assert not _holds_twist(peer, topic)
        assert len(page.errors) == 2 and other.errors == [] and texts == []
        page.let_go()
        robot.come_to_rest()


def test_nothing_is_sent_on_a_topic_of_another_type(peer):
    """Not either when it was given at the start."""
    texts = peer.hear(String, "/texts")
    with steered(topic="/texts") as (node, page):
        wait_for(lambda: page.state["topic"] == "/texts", "the topic")
        page.hold(0.3)
        wait_for(lambda: "/texts has the type std_msgs/msg/String" in node.output, "a warning")
        wait_for(lambda: not _holds_twist(peer, "/texts"), "a publisher made too early to go")
        assert texts == []
        page.let_go()


def test_topics_with_a_listener_are_offered_first(peer):
    """And none of another type."""
    peer.node.create_publisher(Twist, "/a_source", 10)
    peer.hear(Twist, "/z_robot")
    peer.hear(String, "/not_a_command")
    with steered() as (_, page):
        _waited(page, "topics", ["/z_robot", "/a_source"])


def test_the_limits_are_the_controllers(peer):
    """As its parameters say; a page may set others, for all pages; without any, the usual ones."""
    peer.node.declare_parameter("linear.x.max_velocity", 0.4)
    peer.node.declare_parameter("angular.z.max_velocity", math.nan)
    with steered(2) as (_, page, other):
        _waited(page, "limits", {"linear": 1.0, "angular": 2.0})
        robot = Commands(peer, page)
        _waited(page, "limits", {"linear": 0.4, "angular": 2.0})
        page.hold(5.0)
        robot.reach(0.4)
        page.send("limits", linear=0.2, angular=0.5)
        _waited(other, "limits", {"linear": 0.2, "angular": 0.5})
        robot.reach(0.2)


class _Dies(Exception):
    pass


@pytest.mark.parametrize("seen, patience", [(True, 600.0), (False, 0.5)])
def test_a_robot_that_dies_before_it_answers_is_asked_again(
    peer, ros_domain, monkeypatch, seen, patience
):
    """The limits of the next one of its name are received, whether or not the poll saw it end."""
    monkeypatch.setattr("onebot_bringup.steering.steering_page._RESPONSE_TIMEOUT", patience)
    limits = ControllerLimits(peer.node)
    robots = [CommandSubscriber("/robot", "geometry_msgs/msg/Twist")]
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=ros_domain, args=[])
    mute = rclpy.create_node("robot", context=context, start_parameter_services=False)

    def die(request: Any, answer: Any) -> Any:
        raise _Dies

    mute.create_service(GetParameters, "/robot/get_parameters", die)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(mute)

    def asked() -> bool:
        assert limits.update(robots) is None
        try:
            executor.spin_once(0.1)
        except _Dies:
            return True
        return False

    wait_for(asked, "the first robot to be asked")
    executor.shutdown()
    mute.destroy_node()
    rclpy.shutdown(context=context)
    if seen:
        assert limits.update([]) is None
    with Peer(ros_domain, "robot") as robot:
        robot.node.declare_parameter("linear.x.max_velocity", 0.4)
        robot.node.declare_parameter("angular.z.max_velocity", 0.5)
        found = wait_for(lambda: limits.update(robots), "the second robot's limits")
    assert found == Velocity(0.4, 0.5)


def test_given_limits_are_the_most_that_pages_can_set(peer):
    """max_linear and max_angular are the operator's word."""
    with steered(max_linear=0.5, max_angular=0.7) as (_, page):
        _waited(page, "limits", {"linear": 0.5, "angular": 0.7})
        page.send("limits", linear=9.0, angular=0.1)
        _waited(page, "limits", {"linear": 0.5, "angular": 0.1})


def _odometry(x: float, yaw: float) -> Odometry:
    message = Odometry()
    message.pose.pose.position.x = x
    message.pose.pose.orientation.z = math.sin(yaw / 2)
    message.pose.pose.orientation.w = math.cos(yaw / 2)
    message.twist.twist.linear.x, message.twist.twist.angular.z = 0.3, -0.2
    return message


def _shown(page: PageClient, publisher: Any, message: Odometry) -> dict[str, Any]:
    """Publish until the page shows some: the first ones may come before the reader is ready."""

    def condition() -> Any:
        publisher.publish(message)
        return page.state["odometry"]

    found = wait_for(condition, "odometry on the page")
    assert isinstance(found, dict)
    return found


def test_odometry_of_the_robot_that_is_steered_is_shown(peer):
    """The sibling of its topic, whatever else there is; with its age."""
    other = peer.node.create_publisher(Odometry, "/elsewhere", 10)
    with steered() as (_, page):
        assert page.state["odometry"] is None
        wait_for(lambda: other.get_subscription_count(), "the only odometry there is to be heard")
        own = peer.publisher(Odometry, "/velocity_controller/odom")
        wait_for(lambda: not other.get_subscription_count(), "the other one to be left")
        shown = _shown(page, own, _odometry(1.5, 2.0))
        assert shown["topic"] == "/velocity_controller/odom"
        assert (shown["x"], shown["y"], shown["yaw"]) == pytest.approx((1.5, 0.0, 2.0), abs=1e-6)
        assert (shown["linear"], shown["angular"]) == (0.3, -0.2)
        wait_for(lambda: page.state["odometry"]["age"] > 0.5, "it to grow old")
        own.publish(_odometry(math.nan, 0.0))
        wait_for(lambda: page.state["odometry"] is None, "an impossible pose not to be shown")
        assert _shown(page, own, _odometry(1.0, 0.0))["x"] == 1.0


def test_odometry_that_cannot_be_decoded_is_not_shown(peer):
    """The page goes on to hear of everything else, and of the odometry that comes next."""
    with steered() as (_, page):
        own = peer.publisher(Odometry, "/velocity_controller/odom")
        _shown(page, own, _odometry(1.0, 0.0))
        own.publish(b"\0\1\0\0\xff\xff\xff\xff\0\0\0\0")
        wait_for(lambda: page.state["odometry"] is None, "what is none not to be shown")
        count = len(page.states)
        wait_for(lambda: len(page.states) > count + 3, "more states")
        assert _shown(page, own, _odometry(2.0, 0.0))["x"] == 2.0


def test_odometry_can_be_named(peer):
    """odom_topic goes before what would be found."""
    peer.node.create_publisher(Odometry, "/velocity_controller/odom", 10)
    with steered(odom_topic="/mine") as (_, page):
        shown = _shown(page, peer.publisher(Odometry, "/mine"), _odometry(2.0, 0.0))
        assert (shown["topic"], shown["x"]) == ("/mine", 2.0)


VIEW = "http://127.0.0.1:9090/?url=rerun%2Bhttp://127.0.0.1:9876/proxy&theme=dark"


def test_the_view_comes_and_goes_with_the_viewer(peer):
    """A new viewer gives the page another path, so that it loads the view anew."""
    with steered() as (node, page):
        assert page.state["view"] is None
        viewer = peer.publisher(String, "/rerun_viewer/page", LATCHED)
        viewer.publish(String(data=VIEW))
        shown = wait_for(lambda: page.state["view"], "the view")
        host = address_of(node).removeprefix("http://")
        assert shown == f"/view/?url=rerun%2Bhttp://{host}/proxy&theme=dark&view=1"
        peer.node.destroy_publisher(viewer)
        wait_for(lambda: page.state["view"] is None, "the view to go")
        peer.publisher(String, "/rerun_viewer/page", LATCHED).publish(String(data=VIEW))
        _waited(page, "view", shown.replace("view=1", "view=2"))


def test_a_view_elsewhere_is_not_shown(peer):
    """Whoever is on the ROS graph must not make the server ask hosts in its network."""
    with steered() as (node, page):
        viewer = peer.publisher(String, "/rerun_viewer/page", LATCHED)
        viewer.publish(String(data=VIEW.replace("127.0.0.1", "192.0.2.7")))
        wait_for(lambda: "has no address of a page on this computer" in node.output, "a warning")
        assert page.state["view"] is None
