"""Subscribes to a changing set of topics, each with the QoS that its publishers offer."""

import contextlib
from collections.abc import Callable, Container, Iterable, Mapping

from rclpy.node import Node

from onebot_bringup.introspection.transforms import FrameTree
from onebot_description.ros.topic_qos import compatible_qos
from onebot_description.ros.topic_subscription import TopicSubscription, TypeConflictError, offers
from onebot_description.ros.wire.interfaces import TFMessage
from onebot_description.ros.wire.messages import tf_arrays

_STATIC = "/tf_static"
_TF_TOPICS = dict.fromkeys(("/tf", _STATIC), "tf2_msgs/msg/TFMessage")
_TF_DEPTH = 100  # queue depth; /tf has several publishers


def own_topics(
    node: Node, namespace: str, robots: Iterable[str], types: Container[str]
) -> dict[str, str]:
    """Return the topics of some types that are published in a robot's namespace, with their types.

    Args:
        node: the node that has discovered them.
        namespace: the robot's namespace.
        robots: the namespaces of other robots, whose topics are left out.
        types: the message types.
    """
    others = tuple(f"{other}/" for other in robots if other.startswith(f"{namespace}/"))
    return {
        name: kinds[0]
        for name, kinds in node.get_topic_names_and_types()
        if name.startswith(f"{namespace}/") and not name.startswith(others)
        if kinds[0] in types and node.count_publishers(name)
    }


class FollowedTopics:
    """Subscribes to topics while they are needed."""

    def __init__(
        self, node: Node, depth: int, subscribe: Callable[[str, str], TopicSubscription]
    ) -> None:
        """Follow nothing yet.

        Args:
            node: the node that subscribes.
            depth: the queue depth.
            subscribe: prepares the subscription to a topic, given its name and type.
        """
        self._node, self._depth, self._subscribe = node, depth, subscribe
        self._subscriptions: dict[tuple[str, str], TopicSubscription] = {}

    def update(self, topics: Mapping[str, str]) -> set[str]:
        """Follow exactly these topics; call this several times per second.

        Args:
            topics: message types by topic name.

        Returns:
            The types of the topics that are no longer followed.
        """
        gone = self._subscriptions.keys() - topics.items()
        for topic in gone:
            self._subscriptions.pop(topic).close()
        for name, kind in topics.items():
            if (name, kind) not in self._subscriptions:
                self._subscriptions[name, kind] = self._subscribe(name, kind)
            offered = offers(self._node, name, [kind]).get(kind)
            if offered:
                with contextlib.suppress(TypeConflictError):  # the page publishes on it
                    qos = compatible_qos(offered, self._depth)
                    self._subscriptions[name, kind].update(kind, qos)
        return {kind for _, kind in gone}


class FollowedTransforms:
    """Subscribes to TF while it is needed.

    Attributes:
        tree: the frames received; a new tree after each pause.
    """

    def __init__(self, node: Node) -> None:
        self._node, self.tree = node, FrameTree()
        self._topics = FollowedTopics(node, _TF_DEPTH, self._subscription)

    def update(self, needed: bool) -> None:
        """Follow TF if it is ``needed``; call this several times per second."""
        if self._topics.update(_TF_TOPICS if needed else {}):
            self.tree = FrameTree()

    def _subscription(self, name: str, _: str) -> TopicSubscription:
        def received(_: str, data: bytes) -> None:
            with contextlib.suppress(ValueError):  # other nodes report a bad message
                self.tree.add(tf_arrays(data), static=name == _STATIC)

        return TopicSubscription(self._node, name, received, lambda _: TFMessage)
