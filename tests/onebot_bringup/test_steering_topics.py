"""The steering page follows what is on the ROS graph: types, topics, limits, odometry, views."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from urllib.parse import urlsplit

import pytest
import rclpy
from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from onebot_bringup.steering.command_topic import named_robots
from onebot_bringup.steering.followed_topics import FollowedTopics
from onebot_bringup.steering.odometry_topic import choose_odometry
from onebot_control.nodes.command_controllers import Controllers
from tests.onebot_bringup.steering_support import (
    BAD,
    TOPIC,
    Commands,
    PageClient,
    steered,
    visited,
)
from tests.ros_support import LATCHED, Peer
from tests.support import wait_for

STAMPED = "geometry_msgs/msg/TwistStamped"
LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


@contextmanager
def _afresh(shared, pages=1):
    """The node's pages as if it had just been started, with their peer."""
    with visited(*shared, pages) as opened:
        opened[1].send("limits", **_axes(None, None, None))
        for topic in ("/nobody/here", TOPIC):  # whose robots and limits are forgotten
            opened[1].send("topic", topic=topic)
            _waited(opened[1], "topic", topic)
        _waited(opened[1], "listeners", 0)
        yield opened


def _waited(page: PageClient, key: str, value: Any) -> None:
    wait_for(lambda: page.state[key] == value, f"{key} to be {value}; it is {page.state[key]}")


@pytest.mark.parametrize(
    ("topics", "names"),
    [
        (["/velocity_controller/cmd_vel"], ["/velocity_controller/cmd_vel"]),
        (["/r10/velocity_controller/cmd_vel", "/r2/cmd_vel"], ["r2", "r10"]),
        (["/a/b/diff_drive_controller/cmd_vel", "/cmd_vel"], ["/cmd_vel", "a/b"]),
        (["/r1/cmd_vel", "/r1/nav_vel"], ["/r1/cmd_vel", "/r1/nav_vel"]),
    ],
)
def test_robots_are_named_by_their_namespaces(topics, names):
    """Without the controller's; by the topic where that is no name of one robot."""
    assert [robot.name for robot in named_robots(topics)] == names


def test_the_type_is_followed_live(shared):
    """A robot of the other type is driven, though onlookers have the first; the stamp is now."""
    domain = shared[0]
    with (
        _afresh(shared) as (peer, page),
        Peer(domain, "rerun_viewer") as viewer,
        Peer(domain, "a_bridge") as bridge,
    ):
        with Peer(domain, "robot") as robot:
            first = Commands(robot, page, kind=Twist)
            _waited(page, "topic_type", "geometry_msgs/msg/Twist")
            page.hold(0.3)
            first.reach(0.3)
            page.let_go()
        _waited(page, "listeners", 0)
        viewer.hear(Twist, TOPIC, LATEST)  # a viewer is no robot
        page.hold(0.3)
        wait_for(lambda: peer.node.count_subscribers(TOPIC), "the viewer")
        page.let_go()
        bridge.hear(Twist, TOPIC)
        _declare(peer, 0.5, 0.5)
        robot = Commands(peer, page, kind=TwistStamped)
        _waited(page, "topic_type", STAMPED)
        page.hold(0.2)
        robot.reach(0.2)
        stamp = robot.heard[-1].header.stamp
        now = peer.node.get_clock().now().nanoseconds * 1e-9
        assert abs(now - (stamp.sec + stamp.nanosec * 1e-9)) < 60.0


def test_another_topic_is_steered_after_the_old_robot_was_stopped(shared):
    """The old one gets zeros, the new one nothing before somebody takes hold anew."""
    with _afresh(shared) as (peer, page):
        first = Commands(peer, page)
        second = peer.hear(TwistStamped, "/other/cmd_vel")
        wait_for(
            lambda: {TOPIC, "/other/cmd_vel"} <= set(page.state["topics"]), "both topics offered"
        )
        page.hold(0.3)
        first.reach(0.3)
        page.send("topic", topic="/" + "a" * 243)  # DDS takes it, but not its lock's name
        page.send("topic", topic="/other/cmd_vel")
        _waited(page, "topic", "/other/cmd_vel")
        _waited(page, "topic_type", STAMPED)
        first.come_to_rest()
        assert page.state["driver"] is None and second == []
        page.let_go()
        page.hold(0.1)
        wait_for(lambda: second, "commands on the new topic")
        assert {message.twist.linear.x for message in second} == {0.1}


def test_topics_can_be_named_at_the_start(peer):
    """odom_topic goes before what would be found; topics of other types are not offered."""
    peer.hear(String, "/texts")
    peer.hear(Twist, "/z_robot")
    peer.node.create_publisher(Twist, "/a_source", 10)
    peer.node.create_publisher(Odometry, "/odom", 10)
    with steered(topic="/robot/cmd_vel", odom_topic="/mine") as (_, page):
        shown = _shown(page, peer.publisher(Odometry, "/mine"), _odometry(2.0, 0.0))
        assert (shown["topic"], shown["x"]) == ("/mine", 2.0)
        _waited(page, "topic", "/robot/cmd_vel")
        _waited(page, "topics", ["/a_source", "/z_robot"])
        _waited(page, "robots", [{"topic": "/z_robot", "name": "/z_robot"}])


def _axes(linear: Any, angular: Any, lateral: Any = 0.0) -> dict[str, Any]:
    return {"linear": linear, "angular": angular, "lateral": lateral}


def _declare(robot: Peer, linear: float, angular: float, **more: float) -> None:
    values = {"linear.x.max_velocity": linear, "angular.z.max_velocity": angular, **more}
    for name, value in values.items():
        robot.node.declare_parameter(name, value)


def test_the_limits_are_the_controllers(shared):
    """As its parameters say, also while it drives; a page may set lower ones, for all pages."""
    with _afresh(shared, 2) as (peer, page, other):
        _declare(peer, 0.5, math.nan)
        _waited(page, "limits", _axes(1.0, 2.0))
        assert page.state["ceiling"] == _axes(2.0, 4.0)
        assert page.state["ceiling_from"] == _axes("", "", "")
        assert page.state["braking"] == {"linear": None, "lateral": None}
        robot = Commands(peer, page)
        _waited(page, "limits", _axes(0.5, 2.0))
        assert page.state["ceiling"] == _axes(0.5, 4.0)
        assert page.state["ceiling_from"] == _axes("/peer", "", "")
        assert page.state["controllers"] == ["/peer"]
        page.hold(5.0)
        robot.reach(0.5)
        peer.node.set_parameters([Parameter("linear.x.max_velocity", value=0.375)])
        robot.reach(0.375)
        page.send("limits", **_axes(0.25, 3.0, None))
        _waited(other, "limits", _axes(0.25, 3.0))
        robot.reach(0.25)
        page.send("limits", **_axes(None, 9.0, None))
        _waited(other, "limits", _axes(0.375, 4.0))
        assert other.state["chosen"] == _axes(None, 9.0, None)


def test_of_two_controllers_the_stricter_limits_count(shared):
    """A warning names both; their limits stay until another topic is chosen."""
    domain, node = shared
    with _afresh(shared) as (_, page):
        with Peer(domain, "left") as left, Peer(domain, "right") as right:
            _declare(left, 0.25, 3.0)
            _declare(right, 1.0, 1.5)
            for robot in (left, right):
                robot.hear(Twist, TOPIC)
            _waited(page, "ceiling", _axes(0.25, 1.5))
            words = "2 controllers subscribe to /velocity_controller/cmd_vel (/left, /right)"
            wait_for(lambda: words in node.output, words)
        _waited(page, "listeners", 0)
        assert page.state["controllers"] != []
        page.send("topic", topic="/other")
        _waited(page, "controllers", [])
        assert page.state["limits"] == _axes(1.0, 2.0)


@pytest.mark.parametrize(
    "publishers, wanted",
    [
        ({}, ""),
        ({"/far": ["/other"]}, "/far"),
        ({"/far": ["/other"], "/near": ["/another"]}, ""),
        ({"/base/odom": ["/ekf"], "/far": ["/other"]}, "/base/odom"),
        ({"/base/odom": ["/ekf"], "/far": ["/robot"]}, "/far"),
        ({"/robot/odom": ["/robot"], "/robot/ground_truth": ["/robot"]}, "/robot/odom"),
        ({"/robot/a": ["/robot"], "/robot/b": ["/robot"]}, ""),
    ],
)
def test_odometry_is_the_controllers_own_or_the_likeliest(publishers, wanted):
    """Then the sibling of the topic, then the only one."""
    assert choose_odometry(publishers, "/base/cmd_vel", ["/robot"]) == wanted


@contextmanager
def _mute(domain: int, name: str) -> Iterator[None]:
    """A node that is never spun: its parameter services are there, and do not answer."""
    context = rclpy.Context()
    rclpy.init(context=context, domain_id=domain, args=[])
    node = rclpy.create_node(name, context=context)
    yield
    node.destroy_node()
    rclpy.shutdown(context=context)


def test_a_robot_that_dies_before_it_answers_is_asked_again(peer, ros_domain, monkeypatch):
    """The limits of the next one of its name are received.

    Others that never answer, that have no limits, or are no ROS nodes, change nothing.
    """
    monkeypatch.setattr("onebot_control.nodes.command_controllers._PERIOD", 0.5)
    changes: list[None] = []
    controllers = Controllers(peer.node, lambda: changes.append(None))
    with _mute(ros_domain, "robot"):

        def asked() -> bool:
            controllers.update(["/robot"])
            return any(inquiry.due for inquiry in controllers._inquiries.values())

        wait_for(asked, "the first robot to be asked")
    assert controllers.known == () and changes == []
    with Peer(ros_domain, "robot") as robot, _mute(ros_domain, "sleeper"):
        _declare(robot, 0.5, 0.25)

        def known() -> bool:
            controllers.update(["/robot", "/sleeper", "/peer", "/not-a-ros/node", "/"])
            return bool(controllers.known)

        wait_for(known, "the second robot's limits")
    (found,) = controllers.known
    assert found.node == "/robot" and len(changes) == 1
    assert (found.linear.max_velocity, found.angular.max_velocity) == (0.5, 0.25)
    controllers.forget()
    assert controllers.known == () and len(changes) == 2


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


def _hide(page: PageClient, publisher: Any, message: Odometry | bytes) -> None:
    """Publish what cannot be shown until nothing is: a best-effort message may be lost."""

    def hidden() -> bool:
        publisher.publish(message)
        return page.state["odometry"] is None

    wait_for(hidden, "no odometry on the page")


def test_odometry_of_the_robot_that_is_steered_is_shown(shared):
    """The sibling of its topic, whatever else there is; with its age."""
    with _afresh(shared) as (peer, page):
        _waited(page, "odometry", None)
        other = peer.node.create_publisher(Odometry, "/elsewhere", 10)
        wait_for(lambda: other.get_subscription_count(), "the only odometry there is to be heard")
        own = peer.publisher(Odometry, "/velocity_controller/odom")
        wait_for(lambda: not other.get_subscription_count(), "the other one to be left")
        moved = _odometry(1.5, 2.0)
        moved.twist.twist.linear.y = 0.1
        shown = _shown(page, own, moved)
        assert shown["topic"] == "/velocity_controller/odom" and shown["lateral"] == 0.1
        assert (shown["x"], shown["y"], shown["yaw"]) == pytest.approx((1.5, 0.0, 2.0), abs=1e-6)
        assert (shown["linear"], shown["angular"]) == (0.3, -0.2)
        for undecodable in (_odometry(math.nan, 0.0), BAD):
            _hide(page, own, undecodable)
            assert _shown(page, own, _odometry(1.0, 0.0))["x"] == 1.0


VIEW = "http://127.0.0.1:9090/?url=rerun%2Bhttp://127.0.0.1:9876/proxy&theme=dark"


def test_the_view_comes_and_goes_with_the_viewer(shared):
    """Whoever is on the ROS graph must not make the server ask hosts in its network."""
    node = shared[1]
    with visited(*shared) as (peer, page):
        assert page.state["view"] is None
        viewer = peer.publisher(String, "/rerun_viewer/page", LATCHED)
        viewer.publish(String(data=VIEW))
        shown = wait_for(lambda: page.state["view"], "the view")
        own = node.address
        assert [urlsplit(one).netloc for one in shown] == [
            urlsplit(own.replace("127.0.0.1", name)).netloc for name in ("localhost", "127.0.0.1")
        ]
        assert all("/proxy&theme=dark&" in one for one in shown)
        peer.run(peer.node.destroy_publisher, viewer)
        wait_for(lambda: page.state["view"] is None, "the view to go")
        elsewhere = peer.publisher(String, "/rerun_viewer/page", LATCHED)
        elsewhere.publish(String(data=VIEW.replace("127.0.0.1", "192.0.2.7")))
        wait_for(lambda: "has no address of a page on this computer" in node.output, "a warning")
        _waited(page, "view", None)


@pytest.mark.parametrize("qos", [LATCHED, QoSProfile(depth=10), LATEST])
def test_of_streams_only_the_newest_is_kept(peer: Peer, qos: QoSProfile) -> None:
    """A reliable reader of pictures grew for as long as the page was open; latched ones stay."""
    peer.node.create_publisher(String, "/stream", qos)
    follower = peer.node
    topics = FollowedTopics(follower)

    def readers() -> list[Any]:
        peer.run(topics.update, {"/stream": "std_msgs/msg/String"})
        return list(follower.get_subscriptions_info_by_topic("/stream"))

    reliable = qos is LATCHED
    expected = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
    wait_for(lambda: [each.qos_profile.reliability for each in readers()] == [expected], "its QoS")
