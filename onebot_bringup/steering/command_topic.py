"""Publishes commands, and finds the nodes that subscribe to them."""

import re
import threading
from collections.abc import Callable, Container, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from std_msgs.msg import Bool

from onebot_bringup.steering.arbiter import ZEROS
from onebot_bringup.steering.protocol import Velocity
from onebot_control.nodes.velocity_messages import TWIST, VELOCITY_TYPES, twist_of, velocity_message
from onebot_description.errors import natural_order
from onebot_description.ros.names import node_name
from onebot_description.ros.topic_qos import LATCHED
from onebot_description.ros.topic_subscription import RCLError

_DEPTH = 10
_CONTROLLER = re.compile(r"/\w*controller$")  # its command topic is in its namespace
_OBSERVERS = ("_viewer", "_recorder", "_player")  # endings of nodes that are no robots


@dataclass(frozen=True)
class CommandSubscriber:
    """A node that subscribes to commands."""

    node: str  # full name
    kind: str  # the type that it subscribes to

    @property
    def observes(self) -> bool:
        """Whether its name is that of a node that only records or shows commands."""
        name = self.node.rpartition("/")[2]
        return name.startswith("_") or name.endswith(_OBSERVERS)


def command_subscribers(node: Node, topic: str) -> list[CommandSubscriber]:
    """Return the nodes that subscribe to commands on ``topic``."""
    return [
        CommandSubscriber(node_name(end), end.topic_type)
        for end in node.get_subscriptions_info_by_topic(topic)
        if end.topic_type in VELOCITY_TYPES
    ]


def command_topics(node: Node) -> tuple[str, ...]:
    """Return all command topics."""
    topics = node.get_topic_names_and_types()
    return tuple(sorted(name for name, kinds in topics if VELOCITY_TYPES.keys() & {*kinds}))


@dataclass(frozen=True)
class CommandedRobot:
    """A robot that takes commands."""

    topic: str  # the command topic's full name
    name: str  # the robot's namespace; the topic if that names no robot, or several


def commanded_robots(node: Node) -> tuple[CommandedRobot, ...]:
    """Return the robots that take commands on the topics that ``node`` knows."""
    return named_robots(
        [
            topic
            for topic in command_topics(node)
            if any(not end.observes for end in command_subscribers(node, topic))
        ]
    )


def namespace_of(topic: str) -> str:
    """Return the namespace of the robot with this command topic; "" for none."""
    return _CONTROLLER.sub("", topic.rpartition("/")[0])


def named_robots(topics: Sequence[str]) -> tuple[CommandedRobot, ...]:
    """Return the robots with these command topics, sorted by name, robot2 before robot10."""
    names = [namespace_of(topic).strip("/") for topic in topics]
    robots = [
        CommandedRobot(topic, name if name and names.count(name) == 1 else topic)
        for topic, name in zip(topics, names, strict=True)
    ]
    return tuple(sorted(robots, key=lambda robot: natural_order(robot.name)))


class RobotLock:
    """The lock of a robot's commands; a locked robot brakes and ignores all commands.

    Attributes:
        locked: the last known state.
    """

    def __init__(self, node: Node, topic: str, changed: Callable[[bool], None]) -> None:
        """Find the lock of the robot that takes commands on ``topic``.

        ``changed`` is called with ``locked`` when another node has changed it.
        """
        self._node, self._changed, self.topic = node, changed, topic
        self.locked = False
        self._publisher = node.create_publisher(Bool, f"{topic}_lock", _DEPTH)
        self._state = node.create_subscription(Bool, f"{topic}_locked", self._on_state, LATCHED)

    def set(self, locked: bool) -> None:
        """Lock the robot, or unlock it if it is locked; nothing happens if it has no lock."""
        if (locked or self.locked) and self._publisher.get_subscription_count():
            self._publisher.publish(Bool(data=locked))
            self.locked = locked

    def close(self) -> None:
        self._node.destroy_publisher(self._publisher)
        self._node.destroy_subscription(self._state)

    def _on_state(self, message: Bool) -> None:
        if message.data != self.locked:
            self.locked = message.data
            self._changed(self.locked)


class CommandTopic:
    """Publishes commands, from any thread, with the type that the robot subscribes to.

    A node can publish only one type on a topic, and a second type on a topic confuses other tools.
    The publisher is therefore created when there is a subscriber, whose type is then known.
    """

    def __init__(self, node: Node, topic: str, locked: Callable[[bool], None]) -> None:
        self._node, self._locked = node, locked
        self._lock = threading.Lock()
        self._publisher: Any = None
        self.topic = topic
        self.kind = TWIST
        self.subscribers: list[CommandSubscriber] = []  # the nodes that subscribe to the topic
        self.others: list[str] = []  # the other nodes that publish on the topic
        self._robot_lock = RobotLock(node, topic, locked)

    @property
    def listeners(self) -> list[CommandSubscriber]:
        """The subscribers, without nodes that are known to only observe."""
        return [end for end in self.subscribers if not end.observes]

    def publish(self, velocity: Velocity, up: float = 0.0) -> None:
        """Publish a command, with a velocity up, m/s, for a robot that can."""
        with self._lock:
            if self._publisher is not None:
                message = velocity_message(
                    self._node, self.kind, velocity.linear, velocity.lateral, velocity.angular
                )
                twist_of(message).linear.z = up
                self._publisher.publish(message)

    @property
    def locked(self) -> bool:
        return self._robot_lock.locked

    def lock(self, locked: bool) -> None:
        """Lock or unlock the robot; see ``RobotLock.set``."""
        with self._lock:
            self._robot_lock.set(locked)

    def choose(self, topic: str) -> None:
        """Switch to another topic; the robot of the old one must already be stopped."""
        self._destroy_publisher()
        self.topic, self.subscribers = topic, []
        with self._lock:
            self._robot_lock.close()
            self._robot_lock = RobotLock(self._node, topic, self._locked)
        self.update()

    def update(self, controllers: Container[str] = ()) -> None:
        """Adapt to the type of ``controllers``, or else of all subscribers; call this often."""
        self.subscribers = command_subscribers(self._node, self.topic)
        self.others = self._other_publishers()
        robots = [end for end in self.subscribers if end.node in controllers] or self.listeners
        kinds = {end.kind for end in robots or self.subscribers}
        if kinds and self.kind not in kinds:
            for _ in range(ZEROS):  # a robot of the old type may be moving
                self.publish(Velocity())
            self._destroy_publisher()
            self.kind = min(kinds)
        if self._publisher is None and kinds:
            self._create_publisher()

    def flush(self) -> None:
        """Wait briefly until all commands are acknowledged."""
        publisher = self._publisher
        if publisher is not None and publisher.get_subscription_count():
            publisher.wait_for_all_acked(Duration(seconds=0.1))

    def _other_publishers(self) -> list[str]:
        names = [node_name(end) for end in self._node.get_publishers_info_by_topic(self.topic)]
        own_name = self._node.get_fully_qualified_name()
        if self._publisher is not None and own_name in names:
            names.remove(own_name)  # another page's server may have the same name
        return sorted(names)

    def _create_publisher(self) -> None:
        # If the last publisher, of the other type, still exists, the next update tries again.
        with suppress(RCLError):
            publisher = self._node.create_publisher(VELOCITY_TYPES[self.kind], self.topic, _DEPTH)
            with self._lock:
                self._publisher = publisher

    def _destroy_publisher(self) -> None:
        publisher = self._publisher
        if publisher is None:
            return
        self.flush()
        with self._lock:
            self._publisher = None
        self._node.destroy_publisher(publisher)
