"""Looks at the other nodes of the ROS graph: their names, and warnings about them."""

import time
from collections.abc import Sequence

from rclpy.node import Node

from onebot_description.ros.discovery import question, server
from onebot_description.ros.names import node_name
from onebot_description.ros.run_node import steady_timer

_SERVER_ANSWERS = 2.0  # seconds
_POLL_PUBLISHERS = 1.0  # seconds
# A second publisher must exist this long to be reported: a node may end while its successor starts.
# A killed node stays in the graph for 20 s (the lease of Fast DDS).
_SETTLED, _FORGOTTEN = 3.0, 25.0  # seconds


def check_discovery_server(own: Sequence[Node]) -> None:
    """Warn if there is a discovery server, but it finds only this process's ``own`` nodes."""
    node = own[0]

    def check() -> None:
        timer.cancel()
        if len(node.get_node_names()) <= len(own):
            node.get_logger().warning(f"no other node is discovered: {question()}")

    if server():
        timer = steady_timer(node, _SERVER_ANSWERS, check)


class OnlyPublisher:
    """Warns if a topic that should have one publisher has several.

    They must exist for a while, so that a restarted node does not count as a second publisher.
    """

    def __init__(self, node: Node, topic: str, problem: str, *, own: bool) -> None:
        """Watch a ``topic``, whose name is relative to the node's namespace.

        ``problem`` names the consequence of several publishers, and how to fix it; ``own``: whether
        the node itself publishes the topic.
        """
        self._node, self._topic = node, node.resolve_topic_name(topic)
        self._problem = problem
        self._lasting = Lasting(_SETTLED if own else _FORGOTTEN)
        steady_timer(node, _POLL_PUBLISHERS, self._poll)

    def _poll(self) -> None:
        names: list[str] = []
        if self._node.count_publishers(self._topic) > 1:  # counting costs less than the names
            ends = self._node.get_publishers_info_by_topic(self._topic)
            names = sorted(map(node_name, ends))
        if self._lasting.new(names, time.monotonic()):
            text = f"{self._topic} has several publishers, {', '.join(names)}: {self._problem}"
            self._node.get_logger().warning(text)


class Lasting:
    """Reports names once, after they have been present for ``patience`` seconds."""

    def __init__(self, patience: float) -> None:
        """Start without names."""
        self._patience = patience
        self._names: list[str] = []
        self._since = 0.0
        self._reported = True

    def new(self, names: Sequence[str], now: float) -> bool:
        """Return True once when these ``names`` have been present long enough; ``now`` in s."""
        if list(names) != self._names:
            self._names, self._since, self._reported = list(names), now, not names
        if self._reported or now - self._since < self._patience:
            return False
        self._reported = True
        return True
