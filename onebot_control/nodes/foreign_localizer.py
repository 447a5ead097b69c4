"""Detects whether another node localizes the robots: publishes a parent of odom on TF (REP-105).

A frame has only one parent in TF. If a localizer such as AMCL or slam_toolbox publishes the parent
of odom, the simulation does not publish the true one.
"""

import re
from collections.abc import Collection, Iterable, Iterator, Sequence, Set
from os.path import commonprefix
from typing import Any, NamedTuple

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

from onebot_description.geometry.poses import Transform, of_arrays
from onebot_description.ros.names import node_name
from onebot_description.ros.topic_qos import make_qos
from onebot_description.ros.wire.cdr import NS_PER_S
from onebot_description.ros.wire.interfaces import TFMessage
from onebot_description.ros.wire.messages import BAD_MESSAGE, tf_arrays

_TOPICS = {"/tf": False, "/tf_static": True}  # whether each is latched
_DEPTH = 100  # messages kept between two polls; if some are lost, localizers repeat theirs
_POLL_NODES = NS_PER_S  # ns between two looks for the publishers of TF
_KNOWN = 3 * NS_PER_S  # ns within which a node's name is discovered after its messages
_SILENT = 10 * NS_PER_S  # ns; as long as tf2 keeps a transform


class FramesTransform(NamedTuple):
    """A transform on TF: the pose of ``child`` in ``parent``."""

    parent: str
    child: str
    stamp_ns: int
    transform: Transform


class TransformsOf:
    """Finds the transforms of given child frames in serialized TF messages."""

    def __init__(self, children: Iterable[str]) -> None:
        """Compile a search for the names of the ``children``."""
        self.children = frozenset(children)
        # In CDR, the child's name follows the parent's name, a NUL, up to three bytes of
        # padding, and four bytes of length. Most messages have odom as the parent only; these are
        # not parsed.
        common = commonprefix([name[::-1] for name in self.children])[::-1]
        self._end = common.encode() + b"\0"
        any_name = b"|".join(re.escape(name.encode()) for name in self.children)
        self._child = re.compile(rb"[^\0]\0.{4,7}/?(?:" + any_name + rb")\0", re.DOTALL)

    def find(self, data: bytes) -> Iterator[FramesTransform]:
        """Yield these transforms from a TFMessage in CDR; none if ``data`` is not a TFMessage."""
        if self._end not in data or not self._child.search(data):
            return
        try:
            message = tf_arrays(data)
        except BAD_MESSAGE:
            return
        for row, child in enumerate(message.children):
            if child in self.children:
                parent, stamp_ns = message.parents[row], int(message.stamps_ns[row])
                transform = of_arrays(message.translations[row], message.rotations[row])
                yield FramesTransform(parent, child, stamp_ns, transform)


class Localizer:
    """Tracks whether another node publishes a parent of one odometry frame.

    Attributes:
        odom: the odometry frame.
        parent: the parent that another node publishes; "" for none.
    """

    def __init__(self, odom: str) -> None:
        """Start without a parent."""
        self.odom, self.parent = odom, ""
        self._nodes: set[str] = set()  # nodes that published TF when the parent was last received
        self._received_ns = self._alive_ns = 0

    def receive(
        self, transform: FramesTransform, truths: Collection[FramesTransform], now: int
    ) -> None:
        """Remember the parent in a transform of ``odom``, unless the transform is our own.

        Args:
            transform: as received.
            truths: transforms that this process has published lately.
            now: ns, by a steady clock.
        """
        if transform not in truths:
            self.parent, self._nodes = transform.parent, set()
            self._received_ns = self._alive_ns = now

    def expire(self, nodes: Set[str], now: int) -> None:
        """Forget the parent if a node that may have published it has been gone for 10 s.

        Args:
            nodes: the other nodes that publish TF now.
            now: ns, by a steady clock.
        """
        if now - self._received_ns < _KNOWN:
            self._nodes |= nodes
        if self._nodes <= nodes:
            self._alive_ns = now
        elif now - self._alive_ns > _SILENT:
            self.parent = ""


class TransformTap:
    """Polls what other nodes publish on /tf and /tf_static.

    It is polled because an executor would wake up for each transform of all robots.
    """

    def __init__(self, node: Node) -> None:
        """Prepare to subscribe as ``node``; the first ``poll`` does."""
        self._node, self._polled_ns = node, -_POLL_NODES
        self._subscriptions: list[Any] = []
        self.nodes: frozenset[str] = frozenset()  # the other nodes that publish there

    def poll(self, own: Sequence[Node], now: int) -> Iterator[bytes]:
        """Yield the messages received since the last poll, serialized.

        There is no subscription while no other node publishes.

        Args:
            own: nodes whose publishers do not count.
            now: ns, by a steady clock.
        """
        if now - self._polled_ns >= _POLL_NODES:
            self._polled_ns, self.nodes = now, self._other_publishers(own)
            if self.nodes and not self._subscriptions:
                self._subscriptions = [self._subscribed(*topic) for topic in _TOPICS.items()]
            elif not self.nodes:
                self.close()
        for subscription in self._subscriptions:
            while message := subscription.take_message(TFMessage, True):
                yield message[0]

    def close(self) -> None:
        """End the subscriptions."""
        for subscription in self._subscriptions:
            subscription.destroy_when_not_in_use()
        self._subscriptions, self._polled_ns = [], -_POLL_NODES

    def _subscribed(self, topic: str, latched: bool) -> Any:
        # Created without the node, so that its executor does not wait for it.
        qos = make_qos(_DEPTH, reliable=latched, latched=latched)
        with self._node.handle:
            return rclpy_implementation.Subscription(
                self._node.handle, TFMessage, topic, qos.get_c_qos_profile()
            )

    def _other_publishers(self, own: Sequence[Node]) -> frozenset[str]:
        names = {
            node_name(end)
            for topic in _TOPICS
            for end in self._node.get_publishers_info_by_topic(topic)
        }
        return frozenset(names - {"", *(str(node.get_fully_qualified_name()) for node in own)})
