"""The robot's description as nodes get it: by parameter, or by topic."""

from collections.abc import Callable

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_msgs.msg import String

from onebot_description.description import Description, load_description, parse_description
from onebot_description.qos import LATCHED

NAME = "robot_description"  # of the topic and of the parameter
_PATIENCE = 2.0  # seconds without a description before saying so


def is_path(text: str) -> bool:
    """Return whether a parameter robot_description is the path of a file, and not the URDF."""
    return bool(text) and "<" not in text


def described_by(text: str) -> Description:
    """Return what a parameter robot_description describes: it is a URDF, or the path of a file.

    Raises:
        DescriptionError: the description cannot be used.
    """
    return load_description(text) if is_path(text) else parse_description(text, NAME)


class DescriptionTopic:
    """Listens to the topic robot_description, and says so while nothing comes."""

    def __init__(
        self, node: Node, heard: Callable[[str], None], content: Callable[[], bool]
    ) -> None:
        """Subscribe.

        Args:
            node: that listens.
            heard: called with each URDF that comes.
            content: whether the node has a description it can use.
        """
        self._node, self._content = node, content
        node.create_subscription(String, NAME, lambda message: heard(message.data), LATCHED)
        # Not ROS time: it may stand still.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._impatience = node.create_timer(_PATIENCE, self._say_waiting, clock=steady)

    def _say_waiting(self) -> None:
        self._impatience.cancel()
        if not self._content():
            topic = self._node.resolve_topic_name(NAME)
            self._node.get_logger().warning(
                f"waiting for the robot description on {topic}; is robot_state_publisher running?"
            )
