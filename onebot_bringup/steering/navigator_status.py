"""The state of the robot's navigator, a line of text for the page."""

from collections.abc import Sequence

from rclpy.node import Node

from onebot_bringup.steering.followed_topics import FollowedTopics, RobotNamespace

_NAVIGATOR = "navigator"
_TEXT = "std_msgs/msg/String"
_IDLE = "idle"
_LONGEST = 300  # characters


class NavigatorStatus:
    """Subscribes to ~/status of the navigator of the robot that is steered."""

    def __init__(self, node: Node) -> None:
        self._topics = FollowedTopics(node, 1)
        self._node, self._name = node, ""

    def update(self, namespace: RobotNamespace) -> None:
        """Follow the robot's navigator; call this several times per second."""
        self._name = f"{namespace.name}/{_NAVIGATOR}"
        topic = f"{self._name}/status"
        self._topics.update({topic: _TEXT} if self._node.count_publishers(topic) else {})

    @property
    def line(self) -> str:
        """What the navigator does; empty if there is no navigator, or it has had no goal yet."""
        for topic in self._topics.topics:
            message, _ = self._topics.newest(topic)
            if message is not None and message.data != _IDLE:
                return str(message.data)[:_LONGEST]
        return ""

    def others(self, nodes: Sequence[str]) -> list[str]:
        """Return the nodes without the navigator."""
        return [node for node in nodes if node != self._name]
