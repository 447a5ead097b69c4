"""The topic and the parameter robot_description."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

from rclpy.node import Node
from std_msgs.msg import String

from onebot_description.description import Description, parse_description
from onebot_description.errors import OneBotError
from onebot_description.parameters.reader import ConfigError
from onebot_description.ros.node_graph import OnlyPublisher
from onebot_description.ros.run_node import steady_timer
from onebot_description.ros.topic_qos import LATCHED
from onebot_description.timing.throttled import Throttled

GOES_ON = "the robot continues as before"
"""Part of an error about a change that is rejected."""

_DESCRIPTION = "robot_description"  # name of the topic and of the parameter
_PATIENCE = 2.0  # seconds without a description before a warning


class DescriptionTopic:
    """A subscription to robot_description, with a warning when nothing is published."""

    def __init__(
        self,
        node: Node,
        current: Callable[[], Description | None],
        use: Callable[[Description], object],
        places: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """Subscribe.

        Args:
            node: the subscriber.
            current: returns the description in use; None if there is none.
            use: called with each description that differs from it; raises OneBotError if it cannot
                be used, which is logged.
            places: file and line of the node's parameters, for that error.
        """
        self._node, self._current, self._use, self._places = node, current, use, places
        self._refuse = Throttled(lambda text: node.get_logger().error(text))
        node.create_subscription(String, _DESCRIPTION, self._on_description, LATCHED)
        self._timer = steady_timer(node, _PATIENCE, self._warn_once)

    def _on_description(self, message: String) -> None:
        current = self._current()
        if current is not None and message.data == current.urdf:
            return
        try:
            self._use(parse_description(message.data, _DESCRIPTION))
        except OneBotError as error:
            reason = error.located(self._places) if isinstance(error, ConfigError) else error
            goes_on = "still waiting for one" if self._current() is None else GOES_ON
            text = f"{_DESCRIPTION} not applied, {goes_on}:\n{reason}"
            self._refuse("description", text)

    def _warn_once(self) -> None:
        self._timer.cancel()
        if self._current() is None:
            topic = self._node.resolve_topic_name(_DESCRIPTION)
            self._node.get_logger().warning(
                f"waiting for the robot description on {topic}; is robot_state_publisher running?"
            )


def warn_of_two_robots(node: Node, *, own: bool) -> None:
    """Warn if robot_description has several publishers; ``own``: including this node."""
    problem = (
        "nodes see two robots as one. Stop one, start one with namespace:=NAME, or separate them "
        "with domain_id:=N"
    )
    OnlyPublisher(node, _DESCRIPTION, problem, own=own)
