"""Subscriptions to a set of topics that changes, each with the QoS that its publishers offer."""

import contextlib
from collections.abc import Callable, Container, Iterable, Mapping

from rclpy.node import Node

from onebot_description.topic_subscription import (
    TopicSubscription,
    TypeConflictError,
    compatible_qos,
    offers,
)


def own_topics(
    node: Node, namespace: str, robots: Iterable[str], types: Container[str]
) -> dict[str, str]:
    """Return the topics of some types that are published in a robot's namespace, with their types.

    Those in the namespaces of other ``robots`` are not among them.
    """
    others = tuple(f"{other}/" for other in robots if other.startswith(f"{namespace}/"))
    return {
        name: kinds[0]
        for name, kinds in node.get_topic_names_and_types()
        if name.startswith(f"{namespace}/") and not name.startswith(others)
        if kinds[0] in types and node.count_publishers(name)
    }


class FollowedTopics:
    """Subscribes to topics while somebody looks."""

    def __init__(
        self, node: Node, depth: int, subscribe: Callable[[str, str], TopicSubscription]
    ) -> None:
        """``subscribe`` prepares the subscription to a topic, by its name and type."""
        self._node, self._depth, self._subscribe = node, depth, subscribe
        self._subscriptions: dict[tuple[str, str], TopicSubscription] = {}

    def update(self, topics: Mapping[str, str]) -> set[str]:
        """Follow these topics, by name with their types; return the types of the topics let go.

        To be called several times per second: publishers come and go.
        """
        gone = self._subscriptions.keys() - topics.items()
        for topic in gone:
            self._subscriptions.pop(topic).close()
        for name, kind in topics.items():
            if (name, kind) not in self._subscriptions:
                self._subscriptions[name, kind] = self._subscribe(name, kind)
            offered = offers(self._node, name, [kind]).get(kind)
            if offered:
                with contextlib.suppress(TypeConflictError):  # the page steers this topic
                    qos = compatible_qos(offered, self._depth)
                    self._subscriptions[name, kind].update(kind, qos)
        return {kind for _, kind in gone}
