"""Looks at the other nodes of the ROS graph: their names, and warnings about them."""

import time
from collections.abc import Sequence

from rclpy.node import Node

from onebot_description.ros.discovery import question, server
from onebot_description.ros.names import node_name
from onebot_description.ros.steady_timer import steady_timer

_POLL_SERVER = 2.0  # seconds
_POLL_PUBLISHERS = 1.0  # seconds
# How long a second publisher must exist to be reported: a node may end while its successor starts.
# A killed node stays in the graph for 20 s (the lease of Fast DDS).
_SETTLED, _FORGOTTEN = 3.0, 25.0  # seconds


class DiscoveryServerCheck:
    """Warns if the discovery server finds no other node, and logs when it does."""

    def __init__(self, own: Sequence[Node]) -> None:
        """Check periodically, if there is a discovery server; ``own``: nodes of this process."""
        self._node, self._own, self._warned = own[0], len(own), False
        if server():
            self._timer = steady_timer(self._node, _POLL_SERVER, self._poll)

    def _poll(self) -> None:
        alone = len(self._node.get_node_names()) <= self._own
        if alone and not self._warned:
            self._warned = True
            self._node.get_logger().warning(f"no other node is discovered: {question()}")
        elif not alone:
            self._timer.cancel()
            if self._warned:
                self._node.get_logger().info("other nodes are discovered now")


class OnlyPublisher:
    """Warns once of each further publisher of a topic that should have one.

    It must exist for a while, so that a restarted node does not count as a second publisher.
    """

    def __init__(self, node: Node, topic: str, problem: str, *, own: bool) -> None:
        """Watch a ``topic``, whose name is relative to the node's namespace.

        ``problem`` names the consequence of several publishers, and how to fix it; ``own``: the
        node publishes the topic itself.
        """
        self._node, self._topic = node, node.resolve_topic_name(topic)
        self._problem = problem
        self._own = node.get_fully_qualified_name() if own else ""
        self._lasting = Lasting(_SETTLED if own else _FORGOTTEN)
        steady_timer(node, _POLL_PUBLISHERS, self._poll)

    def _poll(self) -> None:
        names = self._names() if self._node.count_publishers(self._topic) > 1 else []
        if not self._lasting.new(names, time.monotonic()):
            return
        rivals = ", ".join(names)
        text = f"also published by {rivals}" if self._own else f"published by {rivals} at once"
        self._node.get_logger().warning(f"{self._topic} is {text}: {self._problem}")

    def _names(self) -> list[str]:
        """Return the nodes that publish it; a name that several nodes have, several times."""
        ends = self._node.get_publishers_info_by_topic(self._topic)
        names = sorted(map(node_name, ends))
        if self._own in names:
            names.remove(self._own)
        return names


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
