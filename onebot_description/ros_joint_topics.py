"""The joint states that joint_state_publisher publishes, and those it hears."""

from array import array
from collections.abc import Callable, Sequence

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from rclpy.timer import Timer
from sensor_msgs.msg import JointState

from onebot_description.joints.config import JointsConfig
from onebot_description.joints.source import JointStateSource

# Takes what sensors publish best effort as well as what is published reliably.
_ANY_SENDER = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
_EMPTY = array("d")


class JointStatesOut:
    """The topic joint_states, published at a rate once there is a robot."""

    def __init__(self, node: Node) -> None:
        """Announce it."""
        self._node = node
        self._publisher = node.create_publisher(JointState, "joint_states", 10)
        self._message = JointState()
        self._source: JointStateSource | None = None
        self._config = JointsConfig()
        self._timer: Timer | None = None
        self._began: int | None = None

    def use(self, source: JointStateSource, config: JointsConfig) -> None:
        """Publish what ``source`` does from now on, as ``config`` says."""
        if source is not self._source:
            self._source, self._message = source, JointState(name=list(source.names))
        if self._timer is None or config.rate != self._config.rate:
            self._set_rate(config.rate)
        self._config = config

    def _set_rate(self, rate: float) -> None:
        if self._timer is not None:
            self._node.destroy_timer(self._timer)
        self._timer = self._node.create_timer(1.0 / rate, self.publish)

    def publish(self) -> None:
        """Publish the joints' state of now; nothing if no joint moves."""
        source, config = self._source, self._config
        if source is None or not source.names:
            return
        now = self._node.get_clock().now()
        # Counted from the first message on, because a float cannot hold nanoseconds since 1970.
        self._began = now.nanoseconds if self._began is None else self._began
        positions, velocities = source.sample((now.nanoseconds - self._began) * 1e-9)
        heard, message = source.feedback, self._message
        shows_positions = config.publish_default_positions or config.moves or heard.any
        message.position = array("d", positions.tobytes()) if shows_positions else _EMPTY
        shows_velocities = (
            config.publish_default_velocities or config.moves or source.moving or heard.any_velocity
        )
        message.velocity = array("d", velocities.tobytes()) if shows_velocities else _EMPTY
        shows_efforts = config.publish_default_efforts or heard.any_effort
        message.effort = array("d", source.efforts().tobytes()) if shows_efforts else _EMPTY
        if shows_positions or shows_velocities or shows_efforts:
            message.header.stamp = now.to_msg()
            self._publisher.publish(message)


class JointStatesIn:
    """The topics whose values count more than all motions."""

    def __init__(self, node: Node, heard: Callable[[str, JointState], None]) -> None:
        """Listen to none so far; ``heard`` gets each topic and message."""
        self._node, self._heard = node, heard
        self._subscriptions: dict[str, Subscription] = {}

    def listen_to(self, topics: Sequence[str]) -> None:
        """Listen to these topics and no others."""
        for topic in set(self._subscriptions).difference(topics):
            self._node.destroy_subscription(self._subscriptions.pop(topic))
        for topic in set(topics).difference(self._subscriptions):
            self._subscriptions[topic] = self._node.create_subscription(
                JointState, topic, lambda message, t=topic: self._heard(t, message), _ANY_SENDER
            )
