"""Subscribes to the topics that a robot view needs, with the types and QoS of their publishers."""

from rclpy.node import Node

from onebot_bringup.introspection.interfaces import message_class
from onebot_bringup.viewer.core.inbox import WantedTopic
from onebot_bringup.viewer.robot_view import RobotView
from onebot_description.errors import OneBotError
from onebot_description.ros.stamp_check import StampCheck
from onebot_description.ros.topic_qos import (
    compatible_qos,
    is_reliable,
    is_transient_local,
    make_qos,
)
from onebot_description.ros.topic_subscription import (
    TopicSubscription,
    choose_type,
    offers,
)
from onebot_description.ros.wire.cdr import HEADER

# Types stamped with the time when they are sent, and the byte offset of the stamp in each.
_STAMPED = {
    "sensor_msgs/msg/JointState": HEADER,
    "nav_msgs/msg/Odometry": HEADER,
    "geometry_msgs/msg/TwistStamped": HEADER,
    "tf2_msgs/msg/TFMessage": HEADER + 4,  # the number of transforms comes first
}


class ViewFeed:
    """Subscribes a node to the topics that a view wants, and offers it the published topics.

    Attributes:
        received: topics on which a message was received.
    """

    def __init__(self, node: Node, view: RobotView) -> None:
        self._node = node
        self._view = view
        self._subscriptions: dict[str, TopicSubscription] = {}
        self.received: set[str] = set()

    def tick(self) -> list[str]:
        """Let the view log the received messages; return its new warnings for the user."""
        return self._view.tick(int(self._node.get_clock().now().nanoseconds))

    def update(self) -> list[str]:
        """Follow changes of the publishers and of the view; call this periodically.

        Returns:
            One sentence per thing that cannot be shown or subscribed.
        """
        problems = self._view.offer(self._published())
        topics = self._view.topics
        for name in self._subscriptions.keys() - topics.keys():
            self._subscriptions.pop(name).close()
        for name, topic in topics.items():
            if name not in self._subscriptions:
                self._subscriptions[name] = self._make(name, topic)
            try:
                self._update(name, topic)
            except OneBotError as error:
                problems.append(str(error))
        return problems

    def _published(self) -> dict[str, str]:
        """Return the type of each topic that has a single type and has, or had, a publisher."""
        node, offered = self._node, {item.topic for item in self._view.offered}
        return {
            name: types[0]
            for name, types in node.get_topic_names_and_types()
            if len(types) == 1 and (name in offered or node.count_publishers(name))
        }

    def _make(self, name: str, topic: WantedTopic) -> TopicSubscription:
        check = StampCheck.from_topic(self._node, name)
        stamped = {} if topic.latched else _STAMPED

        def received(kind: str, data: bytes) -> None:
            now_ns = int(self._node.get_clock().now().nanoseconds)
            if kind in stamped:
                check.take_bytes(data, now_ns, stamped[kind])
            self.received.add(name)
            self._view.take(name, kind, data, now_ns)

        return TopicSubscription(self._node, name, received, message_class)

    def _update(self, name: str, topic: WantedTopic) -> None:
        subscription = self._subscriptions[name]
        names = [kind.name for kind in topic.types]
        offered = offers(self._node, name, names)
        kind = choose_type(offered, subscription.type)
        if len(names) == 1:  # subscribe before it is published, unless optional
            early = subscription.type or not topic.optional
            kind = names[0] if early or any(offered.values()) else None
        if kind is None:
            return
        qos = compatible_qos(offered.get(kind, ()), topic.depth)
        latched = topic.latched or is_transient_local(qos)
        reliable = topic.reliable or latched or (topic.as_published and is_reliable(qos))
        subscription.update(kind, make_qos(topic.depth, reliable=reliable, latched=latched))
