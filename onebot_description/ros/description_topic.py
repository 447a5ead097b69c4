"""The topic and the parameter robot_description."""

from collections.abc import Callable

from rclpy.node import Node
from std_msgs.msg import String

from onebot_description.description import Description, load_description, parse_description
from onebot_description.ros.node_graph import OnlyPublisher
from onebot_description.ros.steady_timer import steady_timer
from onebot_description.ros.topic_qos import LATCHED

_DESCRIPTION = "robot_description"  # name of the topic and of the parameter
_PATIENCE = 2.0  # seconds without a description before a warning


def is_path(text: str) -> bool:
    """Return whether the value of robot_description is the path of a file, not the URDF."""
    return bool(text) and "<" not in text


def described_by(text: str) -> Description:
    """Load the description that the value of robot_description contains, or whose path it is."""
    return load_description(text) if is_path(text) else parse_description(text, _DESCRIPTION)


class DescriptionTopic:
    """A subscription to robot_description, with a warning when nothing is published."""

    def __init__(
        self, node: Node, received: Callable[[str], None], has_one: Callable[[], bool]
    ) -> None:
        """Subscribe.

        Args:
            node: the subscriber.
            received: called with each URDF.
            has_one: returns whether the node already has a usable description.
        """
        self._node, self._has_one = node, has_one
        node.create_subscription(
            String, _DESCRIPTION, lambda message: received(message.data), LATCHED
        )
        self._timer = steady_timer(node, _PATIENCE, self._warn_once)

    def _warn_once(self) -> None:
        self._timer.cancel()
        if not self._has_one():
            topic = self._node.resolve_topic_name(_DESCRIPTION)
            self._node.get_logger().warning(
                f"waiting for the robot description on {topic}; is robot_state_publisher running?"
            )


def warn_of_two_robots(node: Node, *, own: bool) -> None:
    """Warn if robot_description has several publishers; ``own``: the node is one of them."""
    problem = (
        "two robots take turns in one. Stop one, or start one with namespace:=NAME, or apart from "
        "the other with domain_id:=N"
    )
    OnlyPublisher(node, _DESCRIPTION, problem, own=own)
