"""The topic that the steering page publishes on, and who listens there."""

import threading
from dataclasses import dataclass
from typing import Any

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

from onebot_bringup.steering.arbiter import ZEROS
from onebot_bringup.steering.protocol import Velocity

RCLError = rclpy_implementation.RCLError

_TYPES = {"geometry_msgs/msg/Twist": Twist, "geometry_msgs/msg/TwistStamped": TwistStamped}
_DEPTH = 10
_WARN_EVERY = 5.0  # s
_ONLOOKERS = (
    "rerun_viewer",
    "steering_viewer",
    "bag_recorder",
    "rosbag2_recorder",
    "rosbag2_player",
)


@dataclass(frozen=True)
class Listener:
    """A robot that takes commands: its node's full name, and the type it takes."""

    node: str
    kind: str


def listeners(node: Node, topic: str) -> list[Listener]:
    """Return who takes commands on ``topic``, in full, without those that only look on."""
    found = []
    for end in node.get_subscriptions_info_by_topic(topic):
        looks_on = end.node_name.startswith("_") or end.node_name in _ONLOOKERS
        if end.topic_type in _TYPES and not looks_on:
            name = f"{end.node_namespace.rstrip('/')}/{end.node_name}"
            found.append(Listener(name, end.topic_type))
    return found


def command_topics(node: Node) -> tuple[str, ...]:
    """Return all topics of commands, the ones that somebody listens to first."""
    named = [
        name
        for name, kinds in node.get_topic_names_and_types()
        if any(kind in _TYPES for kind in kinds)
    ]
    return tuple(sorted(named, key=lambda name: (not listeners(node, name), name)))


def foreign_type(node: Node, topic: str) -> str:
    """Return the type of a topic, in full, that exists with others than commands' only; or "".

    The commands of ``node`` itself do not count.
    """
    ends = node.get_publishers_info_by_topic(topic) + node.get_subscriptions_info_by_topic(topic)
    own = node.get_name(), node.get_namespace()
    kinds = {
        end.topic_type
        for end in ends
        if (end.node_name, end.node_namespace) != own or end.topic_type not in _TYPES
    }
    return "" if kinds & _TYPES.keys() else ", ".join(sorted(kinds))


class CommandTopic:
    """Publishes commands, as the type that the robot takes; from any thread.

    One node can publish one type on a topic only, and whoever finds another one there cannot tell
    any more which it is. So there is no publisher before the robot's type is known, unless somebody
    drives already.

    Attributes:
        topic: in full.
        kind: its type.
        listeners: who takes commands there.
    """

    def __init__(self, node: Node, topic: str) -> None:
        """Begin with ``topic``, a name in full."""
        self._node = node
        self._lock = threading.Lock()
        self._publisher: Any = None
        self._wanted = False  # somebody drives
        self.topic = topic
        self.kind = "geometry_msgs/msg/Twist"
        self.listeners: list[Listener] = []

    def publish(self, velocity: Velocity) -> None:
        """Send a command, if there is anything to send it with."""
        with self._lock:
            self._wanted = True
            if self._publisher is not None:
                self._publisher.publish(self._message(velocity))

    def choose(self, topic: str) -> None:
        """Publish on another topic from now on; the robot of the old one is stopped."""
        self._leave()
        self.topic, self.listeners, self._wanted = topic, [], False
        self.look()

    def look(self) -> None:
        """Follow the type that the robot takes; to be called some times a second."""
        self.listeners = listeners(self._node, self.topic)
        foreign = foreign_type(self._node, self.topic)
        if foreign:  # whoever looks there must not find commands' type
            self._leave()
            if self._wanted:
                self._complain(foreign)
            return
        kinds = {listener.kind for listener in self.listeners}
        if kinds and self.kind not in kinds:
            self._leave()
            self.kind = min(kinds)
        if self._publisher is None and (kinds or self._wanted):
            self._enter()

    def flush(self) -> None:
        """Wait until what was sent has arrived, but not long."""
        publisher = self._publisher
        if publisher is not None and publisher.get_subscription_count():
            publisher.wait_for_all_acked(Duration(seconds=0.1))

    def _complain(self, kind: str) -> None:
        self._node.get_logger().warning(
            f"{self.topic} holds {kind}, not Twist or TwistStamped: nothing is sent",
            throttle_duration_sec=_WARN_EVERY,
        )

    def _enter(self) -> None:
        try:
            publisher = self._node.create_publisher(_TYPES[self.kind], self.topic, _DEPTH)
        except RCLError:
            # The last one, of the other type, is not gone yet; the next look tries again.
            return
        with self._lock:
            self._publisher = publisher

    def _leave(self) -> None:
        publisher = self._publisher
        if publisher is None:
            return
        if self._wanted:
            for _ in range(ZEROS):
                self.publish(Velocity())
            self.flush()
        with self._lock:
            self._publisher = None
        self._node.destroy_publisher(publisher)

    def _message(self, velocity: Velocity) -> Any:
        message = _TYPES[self.kind]()
        twist = message
        if isinstance(message, TwistStamped):
            message.header.stamp = self._node.get_clock().now().to_msg()
            twist = message.twist
        twist.linear.x, twist.angular.z = velocity.linear, velocity.angular
        return message
