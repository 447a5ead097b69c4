"""Subscribes to a changing set of topics, each with the QoS that its publishers offer."""

import contextlib
import math
from collections.abc import Callable, Collection, Container, Mapping
from functools import cached_property, partial
from typing import Any, NamedTuple

from rclpy.node import Node

from onebot_description.ros.frame_tree import FrameTree
from onebot_description.ros.tf_subscription import subscribe_to_tf
from onebot_description.ros.topic_qos import compatible_qos, is_transient_local, make_qos
from onebot_description.ros.topic_subscription import TopicSubscription, TypeConflictError, offers
from onebot_description.ros.wire.interfaces import load_interface
from onebot_description.ros.wire.message_arrays import BAD_MESSAGE, TfArrays, odometry_sample
from onebot_description.ros.wire.messages import deserialize_message
from onebot_description.timing.wake_detector import boot_time

ODOMETRY = "nav_msgs/msg/Odometry"
_READERS: Mapping[str, Callable[[bytes], Any]] = {ODOMETRY: odometry_sample}


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


class Received:
    """A message that was received; it is decoded when it is first needed."""

    def __init__(self, kind: str, data: bytes) -> None:
        self._kind, self._data, self.time = kind, data, boot_time()

    @property
    def age(self) -> float:
        """Seconds since it was received."""
        return boot_time() - self.time

    @cached_property
    def message(self) -> Any:
        """The message, or its arrays; None if it is invalid, which other nodes report."""
        try:
            if reader := _READERS.get(self._kind):
                return reader(self._data)
            return deserialize_message(self._data, load_interface(self._kind))
        except BAD_MESSAGE:
            return None


class Nothing:
    """Stands for the message of a topic from which none was received."""

    message, time, age = None, -math.inf, math.inf


class FollowedTopics:
    """Subscribes to topics while they are needed, and keeps the newest message of each.

    ``newest`` and ``recent`` may be called from any thread.

    Attributes:
        node: the node that subscribes.
        topics: message types by topic name.
        tree: the frames on TF; a new tree after each pause.
    """

    def __init__(self, node: Node) -> None:
        self.node, self.tree = node, FrameTree()
        self._tf: list[Any] = []  # the subscriptions to TF
        self._subscriptions: dict[tuple[str, str], TopicSubscription] = {}
        self.topics: Mapping[str, str] = {}
        self._newest: dict[str, Received] = {}  # keys: topics

    def newest(self, topic: str) -> Received | Nothing:
        """Return the newest message of a topic, if there is one."""
        return self._newest.get(topic) or Nothing()

    def recent(self, types: Container[str], max_age: float) -> list[Any]:
        """Return each topic's newest message of some types, unless older than ``max_age``, s."""
        newest = [self.newest(topic) for topic, kind in self.topics.items() if kind in types]
        messages = [received.message for received in newest if received.age < max_age]
        return [message for message in messages if message is not None]

    def update(self, topics: Mapping[str, str]) -> None:
        """Follow exactly these topics; call this several times per second.

        Args:
            topics: message types by topic name.
        """
        self.topics = topics
        for topic in self._subscriptions.keys() - topics.items():
            self._subscriptions.pop(topic).close()
            self._newest.pop(topic[0], None)
        for name, kind in topics.items():
            if (name, kind) not in self._subscriptions:
                received = partial(self._receive, name)
                self._subscriptions[name, kind] = TopicSubscription(
                    self.node, name, received, load_interface
                )
            offered = offers(self.node, name, [kind]).get(kind)
            if offered:
                with contextlib.suppress(TypeConflictError):  # the page publishes on it
                    qos = compatible_qos(offered, 1)
                    if not is_transient_local(qos):
                        # Only the newest counts. Fast DDS's reliable reader leaked pictures of a
                        # camera: 5 to 9 MB a minute.
                        qos = make_qos(1, reliable=False, latched=False)
                    self._subscriptions[name, kind].update(kind, qos)

    def update_transforms(self, needed: bool) -> None:
        """Follow TF if it is ``needed``; call this several times per second."""
        if needed == bool(self._tf):
            return
        while self._tf:
            self.node.destroy_subscription(self._tf.pop())
        self.tree = FrameTree()
        if needed:
            self._tf = subscribe_to_tf(self.node, self._receive_transforms)

    def _receive(self, topic: str, kind: str, data: bytes) -> None:
        self._newest[topic] = Received(kind, data)

    def _receive_transforms(self, message: TfArrays, static: bool) -> None:
        self.tree.add(message, static=static)
