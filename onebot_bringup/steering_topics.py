"""The topics of the steering page: the command it publishes and the odometry it hears."""

import math
import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import GetParameters
from rclpy.duration import Duration
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from onebot_bringup.raw_messages import odometry_sample
from onebot_bringup.steering.arbiter import ZEROS
from onebot_bringup.steering.protocol import Velocity

RCLError = rclpy_implementation.RCLError

_TYPES = {"geometry_msgs/msg/Twist": Twist, "geometry_msgs/msg/TwistStamped": TwistStamped}
_ODOMETRY = "nav_msgs/msg/Odometry"
_LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
_DEPTH = 10
_ONLOOKERS = (
    "rerun_viewer",
    "steering_viewer",
    "bag_recorder",
    "rosbag2_recorder",
    "rosbag2_player",
)
_LIMITS = ("linear.x.max_velocity", "angular.z.max_velocity")
_DOUBLE, _INTEGER = 3, 2  # rcl_interfaces/msg/ParameterType


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


class OdometryTopic:
    """Hears where the robot is.

    Attributes:
        topic: the one that is heard, in full; "" while there is none.
    """

    def __init__(self, node: Node, fixed: str) -> None:
        """Hear ``fixed``, a name in full, or else ("") what ``look`` finds."""
        self._node, self._fixed = node, fixed
        self._subscription: Any = None
        self._data: tuple[bytes, float] | None = None
        self.topic = ""

    def look(self, commands: str) -> None:
        """Follow the robot that takes ``commands``; to be called some times a second.

        Its odometry is the sibling "odom" of that topic, or else the only Odometry there is.
        """
        wanted = self._fixed or self._found(commands)
        if wanted == self.topic:
            return
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription, self.topic, self._data = None, "", None
        elif wanted:
            try:
                self._subscription = self._node.create_subscription(
                    Odometry, wanted, self._hear, _LATEST, raw=True
                )
            except RCLError:
                return  # it has another type; it may have the right one later
            self.topic = wanted

    def fields(self) -> dict[str, Any] | None:
        """Return the latest as the page's state has it: m, rad, m/s, rad/s, and its age in s."""
        data = self._data
        if data is None:
            return None
        sample = odometry_sample(data[0])
        x, y, z, w = sample.rotation.tolist()
        values = {
            "x": float(sample.translation[0]),
            "y": float(sample.translation[1]),
            "yaw": math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z),
            "linear": float(sample.linear[0]),
            "angular": float(sample.angular[2]),
            "age": time.monotonic() - data[1],
        }
        if not all(map(math.isfinite, values.values())):
            return None
        rounded = {name: round(value, 6) for name, value in values.items()}
        return {"topic": self.topic, **rounded}

    def _hear(self, data: bytes) -> None:
        self._data = data, time.monotonic()

    def _found(self, commands: str) -> str:
        known = [
            name
            for name, kinds in self._node.get_topic_names_and_types()
            if _ODOMETRY in kinds and self._node.count_publishers(name)
        ]
        sibling = f"{commands.rpartition('/')[0]}/odom"
        return sibling if sibling in known else known[0] if len(known) == 1 else ""


class ControllerLimits:
    """Asks the robot's controller how fast it may go, by its parameters."""

    def __init__(self, node: Node) -> None:
        """Ask nobody yet."""
        self._node = node
        self._asked = ""
        self._client: Any = None
        self._answer: Any = None

    def look(self, robots: Iterable[Listener]) -> Velocity | None:
        """Ask, if it is a new robot; return its limits, once, as soon as they are there.

        A limit that it does not tell, or that is none, comes out as NaN.
        """
        names = [robot.node for robot in robots]
        if names and self._asked not in names:
            self._drop()
            self._asked = names[0]
            service = f"{self._asked}/get_parameters"
            self._client = self._node.create_client(GetParameters, service)
        if self._client is None:
            return None
        if self._answer is None and self._client.service_is_ready():
            self._answer = self._client.call_async(GetParameters.Request(names=_LIMITS))
        if self._answer is None or not self._answer.done():
            return None
        values = [_number(value) for value in self._answer.result().values]
        self._drop()
        return Velocity(*values) if len(values) == len(_LIMITS) else Velocity(math.nan, math.nan)

    def _drop(self) -> None:
        if self._client is not None:
            self._node.destroy_client(self._client)
        self._client = self._answer = None


def _number(value: Any) -> float:
    number = {_DOUBLE: value.double_value, _INTEGER: value.integer_value}.get(value.type, math.nan)
    return float(number) if math.isfinite(number) and number > 0.0 else math.nan
