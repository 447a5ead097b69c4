"""Subscribes to a changing set of topics, each with the QoS that its publishers offer."""

import contextlib
import math
from collections.abc import Callable, Collection, Container, Mapping
from functools import cached_property, partial
from typing import Any, NamedTuple

from rclpy.node import Node

from onebot_description.ros.frame_tree import FrameTree
from onebot_description.ros.topic_qos import compatible_qos, is_transient_local, make_qos
from onebot_description.ros.topic_subscription import TopicSubscription, TypeConflictError, offers
from onebot_description.ros.wire.interfaces import load_interface
from onebot_description.ros.wire.message_arrays import (
    BAD_MESSAGE,
    TfArrays,
    odometry_sample,
    tf_arrays,
)
from onebot_description.ros.wire.messages import deserialize_message
from onebot_description.timing.wake_detector import boot_time

ODOMETRY = "nav_msgs/msg/Odometry"
_TF, _STATIC = "tf2_msgs/msg/TFMessage", "/tf_static"
_TF_TOPICS = dict.fromkeys(("/tf", _STATIC), _TF)
_TF_DEPTH = 100  # queue depth; /tf has several publishers
_READERS: Mapping[str, Callable[[bytes], Any]] = {ODOMETRY: odometry_sample, _TF: tf_arrays}


class RobotNamespace(NamedTuple):
    """The namespace of the robot that is steered."""

    name: str  # "" for none
    others: Collection[str]  # the namespaces of other robots

    def topics(self, node: Node, types: Container[str]) -> dict[str, str]:
        """Return the published topics of some types in it, with their types.

        Topics of other robots are left out.

        Args:
            node: the node that has discovered them.
            types: the message types.
        """
        prefixes = tuple(f"{space}/" for space in self.others if space.startswith(f"{self.name}/"))
        return {
            topic: kinds[0]
            for topic, kinds in node.get_topic_names_and_types()
            if topic.startswith(f"{self.name}/") and not topic.startswith(prefixes)
            if kinds[0] in types and node.count_publishers(topic)
        }


class _Received:
    """A message that was received; it is decoded when it is first needed."""

    def __init__(self, kind: str, data: bytes) -> None:
        self._kind, self._data, self.time = kind, data, boot_time()

    @cached_property
    def message(self) -> Any:
        """The message, or its arrays; None if it is invalid, which other nodes report."""
        try:
            if reader := _READERS.get(self._kind):
                return reader(self._data)
            return deserialize_message(self._data, load_interface(self._kind))
        except BAD_MESSAGE:
            return None


class FollowedTopics:
    """Subscribes to topics while they are needed, and keeps the newest message of each.

    All methods but ``update`` may be called from any thread.

    Attributes:
        topics: message types by topic name.
    """

    def __init__(
        self,
        node: Node,
        depth: int,
        received: Mapping[str, Callable[[str, Any], None]] | None = None,
    ) -> None:
        """Follow nothing yet.

        Args:
            node: the node that subscribes.
            depth: the queue depth.
            received: by type, functions called with the topic's name and each valid message.
        """
        self._node, self._depth, self._received = node, depth, received or {}
        self._subscriptions: dict[tuple[str, str], TopicSubscription] = {}
        self.topics: Mapping[str, str] = {}
        self._newest: dict[str, _Received] = {}  # keys: topics

    def newest(self, topic: str) -> tuple[Any, float]:
        """Return the newest message of a topic, and its age in s; None and infinity for none.

        The message is None if it is invalid.
        """
        newest = self._newest.get(topic)
        return (newest.message, boot_time() - newest.time) if newest else (None, math.inf)

    def recent(self, types: Container[str], max_age: float) -> list[Any]:
        """Return each topic's newest message of some types, unless older than ``max_age``, s."""
        newest = [self.newest(topic) for topic, kind in self.topics.items() if kind in types]
        return [message for message, age in newest if age < max_age and message is not None]

    def update(self, topics: Mapping[str, str]) -> set[str]:
        """Follow exactly these topics; call this several times per second.

        Args:
            topics: message types by topic name.

        Returns:
            The types of the topics that are no longer followed.
        """
        self.topics = topics
        gone = self._subscriptions.keys() - topics.items()
        for topic in gone:
            self._subscriptions.pop(topic).close()
            self._newest.pop(topic[0], None)
        for name, kind in topics.items():
            if (name, kind) not in self._subscriptions:
                received = partial(self._receive, name)
                self._subscriptions[name, kind] = TopicSubscription(
                    self._node, name, received, load_interface
                )
            offered = offers(self._node, name, [kind]).get(kind)
            if offered:
                with contextlib.suppress(TypeConflictError):  # the page publishes on it
                    qos = compatible_qos(offered, self._depth)
                    if self._depth == 1 and not is_transient_local(qos):
                        # Only the newest counts. Fast DDS's reliable reader leaked pictures of a
                        # camera: 5 to 9 MB a minute.
                        qos = make_qos(1, reliable=False, latched=False)
                    self._subscriptions[name, kind].update(kind, qos)
        return {kind for _, kind in gone}

    def _receive(self, topic: str, kind: str, data: bytes) -> None:
        self._newest[topic] = newest = _Received(kind, data)
        if kind in self._received and newest.message is not None:
            self._received[kind](topic, newest.message)


class FollowedTransforms:
    """Subscribes to TF while it is needed.

    Attributes:
        tree: the frames received; a new tree after each pause.
    """

    def __init__(self, node: Node) -> None:
        self.tree = FrameTree()
        self._topics = FollowedTopics(node, _TF_DEPTH, {_TF: self._receive})

    def update(self, needed: bool) -> None:
        """Follow TF if it is ``needed``; call this several times per second."""
        if self._topics.update(_TF_TOPICS if needed else {}):
            self.tree = FrameTree()

    def _receive(self, topic: str, transforms: TfArrays) -> None:
        self.tree.add(transforms, static=topic == _STATIC)
