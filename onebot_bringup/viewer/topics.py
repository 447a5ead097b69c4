"""Subscribes to the topics that a robot view needs, whatever type and QoS their publishers have."""

from collections.abc import Callable, Collection, Mapping

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from onebot_bringup.introspection.interfaces import message_class
from onebot_bringup.viewer.inbox import WantedTopic
from onebot_description.clock_check import StampCheck
from onebot_description.errors import OneBotError
from onebot_description.topic_subscription import (
    TopicSubscription,
    TypeConflictError,
    choose_type,
    compatible_qos,
    is_reliable,
    is_transient_local,
    offers,
)
from onebot_description.wire.cdr import HEADER

# Types stamped with the time when they are sent, and the byte of the stamp in each.
_STAMPED = {
    "sensor_msgs/msg/JointState": HEADER,
    "nav_msgs/msg/Odometry": HEADER,
    "geometry_msgs/msg/TwistStamped": HEADER,
    "tf2_msgs/msg/TFMessage": HEADER + 4,  # of the first transform, after their number
}
# Topic (its full name), type, message, and when it was received, nanoseconds.
Take = Callable[[str, str, bytes, int], None]


def published_topics(node: Node, known: Collection[str] = ()) -> dict[str, str]:
    """Return the topics that have one type, and a publisher, by full names.

    Args:
        node: whose knowledge of the ROS graph is used; its own subscriptions do not count.
        known: topics that need no publisher any more.
    """
    return {
        name: types[0]
        for name, types in node.get_topic_names_and_types()
        if len(types) == 1 and (name in known or node.count_publishers(name))
    }


class TopicSubscriptions:
    """Keeps a node subscribed to the topics wanted, each once, and passes raw messages on."""

    def __init__(self, node: Node, take: Take) -> None:
        self._node = node
        self._take = take
        self._wanted: Mapping[str, WantedTopic] = {}
        self._subscriptions: dict[str, TopicSubscription] = {}
        self._reported: set[str] = set()

    def set_topics(self, topics: Mapping[str, WantedTopic]) -> None:
        """Subscribe to ``topics`` (by full names), and to nothing else.

        Raises:
            OneBotError: the node has subscribed to one of them as another type; the others work.
        """
        self._wanted = topics
        for name in set(self._subscriptions) - set(topics):
            self._subscriptions.pop(name).close()
        for name in set(topics) - set(self._subscriptions):
            self._subscriptions[name] = self._make(name)
        self.update()

    def update(self) -> None:
        """Follow publishers that come with another type or durability; call it now and then.

        Raises:
            OneBotError: as ``set_topics``.
        """
        problems = []
        for name, topic in self._wanted.items():
            try:
                self._update(name, topic)
            except TypeConflictError as error:
                problems.append(f"the view's {error}")
            except OneBotError as error:
                # A type that is not installed stays so; of what nobody has asked for, once.
                if not topic.optional or str(error) not in self._reported:
                    problems.append(str(error))
                self._reported.add(str(error))
        if problems:
            raise OneBotError("; ".join(problems))

    def _make(self, name: str) -> TopicSubscription:
        check = StampCheck.of(self._node, name)
        stamped = {} if self._wanted[name].latched else _STAMPED

        def received(kind: str, data: bytes) -> None:
            now_ns = int(self._node.get_clock().now().nanoseconds)
            if kind in stamped:
                check.take_bytes(data, now_ns, stamped[kind])
            self._take(name, kind, data, now_ns)

        return TopicSubscription(self._node, name, received, message_class)

    def _update(self, name: str, topic: WantedTopic) -> None:
        subscription = self._subscriptions[name]
        known = [kind.name for kind in topic.types]
        found = offers(self._node, name, known)
        kind = choose_type(found, subscription.type)
        if len(known) == 1:  # subscribed before it is published, unless optional
            early = subscription.type or not topic.optional
            kind = known[0] if early or any(found.values()) else None
        if kind is None:
            return
        offered = compatible_qos(found.get(kind, ()), topic.depth)
        if subscription.qos is not None and not any(found.values()):
            offered = subscription.qos
        latched = topic.latched or is_transient_local(offered)
        reliable = topic.reliable or latched or (topic.as_published and is_reliable(offered))
        subscription.update(kind, _qos(reliable=reliable, latched=latched, depth=topic.depth))


def _qos(*, reliable: bool, latched: bool, depth: int) -> QoSProfile:
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
