"""Subscribes to the topics that a robot view wants, whatever type and QoS their publishers have."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from onebot_bringup.introspection.interfaces import message_class
from onebot_bringup.viewer.displays.display import Topic
from onebot_description.errors import OneBotError

_DEPTH = 100  # messages; of latched topics also publishers, each with a last message of its own
RCLError = rclpy_implementation.RCLError
# Topic (its full name), type, message, and when it was received, nanoseconds.
Take = Callable[[str, str, bytes, int], None]


@dataclass
class _Subscription:
    kind: str
    latched: bool
    subscription: Any


class TopicSubscriptions:
    """Keeps a node subscribed to the topics wanted, each once, and passes raw messages on."""

    def __init__(self, node: Node, take: Take) -> None:
        """Subscribe on ``node``; ``take`` gets the messages."""
        self._node = node
        self._take = take
        self._wanted: Mapping[str, Topic] = {}
        self._subscriptions: dict[str, _Subscription] = {}

    def set_topics(self, topics: Mapping[str, Topic]) -> None:
        """Subscribe to ``topics`` (by full names), and to nothing else.

        Raises:
            OneBotError: the node has subscribed to one of them as another type; the others work.
        """
        self._wanted = topics
        for name in set(self._subscriptions) - set(topics):
            self._drop(name)
        self.watch()

    def watch(self) -> None:
        """Follow publishers that come with another type or durability; call it now and then.

        Raises:
            OneBotError: as ``set_topics``.
        """
        problems = []
        for name, topic in self._wanted.items():
            kind, latched = self._offered(name, topic)
            now = self._subscriptions.get(name)
            if now is None and kind is not None:
                try:
                    self._subscribe(name, topic, kind, latched)
                except OneBotError as error:
                    problems.append(str(error))
            elif (
                now is not None and kind is not None and (now.kind, now.latched) != (kind, latched)
            ):
                # A node can subscribe to a topic as one type only, and the executor lets go of the
                # old subscription after this callback: the new one is made when called again.
                self._drop(name)
        if problems:
            raise OneBotError("; ".join(problems))

    def _offered(self, name: str, topic: Topic) -> tuple[str | None, bool]:
        """The type to subscribe (None: not known yet), and whether to ask for latched messages.

        The type is that of the publishers, or else of other subscribers, so as to be early. What
        every publisher offers latched is subscribed so.
        """
        known = [kind.name for kind in topic.types]
        now = self._subscriptions.get(name)
        publishers = self._node.get_publishers_info_by_topic(name)
        ours = [end for end in publishers if end.topic_type in known]
        durabilities = {end.qos_profile.durability for end in ours}
        latched = topic.latched or durabilities == {DurabilityPolicy.TRANSIENT_LOCAL}
        if not ours and now is not None:
            latched = now.latched
        if len(known) == 1:
            return known[0] if ours or now or not topic.optional else None, latched
        for ends in (ours, self._node.get_subscriptions_info_by_topic(name)):
            there = {end.topic_type for end in ends if end.topic_type in known}
            if now is not None and now.kind in there:
                return now.kind, latched
            if there:
                return min(there), latched
        return None, latched

    def _subscribe(self, name: str, topic: Topic, kind: str, latched: bool) -> None:
        qos = QoSProfile(
            depth=_DEPTH,
            reliability=ReliabilityPolicy.RELIABLE
            if topic.reliable or latched
            else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )

        def on_message(data: bytes) -> None:
            self._take(name, kind, data, int(self._node.get_clock().now().nanoseconds))

        try:
            subscription = self._node.create_subscription(
                message_class(kind), name, on_message, qos, raw=True
            )
        except RCLError as error:
            raise OneBotError(
                f'the view\'s topic "{name}" cannot be subscribed as {kind}: the viewer has '
                "subscribed to it as another type"
            ) from error
        self._subscriptions[name] = _Subscription(kind, latched, subscription)

    def _drop(self, name: str) -> None:
        self._node.destroy_subscription(self._subscriptions.pop(name).subscription)
