"""The page's tools, which publish a click on the ground as a message, as in RViz."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from geometry_msgs.msg import PointStamped, PoseStamped, PoseWithCovarianceStamped
from rclpy.node import Node

from onebot_bringup.steering.command_topic import CommandTopic, namespace_of
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import about_z
from onebot_description.parameters.reader import REQUIRED, parameter
from onebot_description.ros.wire.messages import fill_diagonal

_DEPTH = 10


class Tool(NamedTuple):
    """The topic and the message type that a tool publishes."""

    topic: str  # below the robot's namespace
    kind: Any


TOOLS: Mapping[str, Tool] = {
    "goal": Tool("goal_pose", PoseStamped),
    "estimate": Tool("initialpose", PoseWithCovarianceStamped),
    "point": Tool("clicked_point", PointStamped),
}
# RViz's covariance: standard deviations of 0.5 m along x and y, and of 15 degrees about z.
_ESTIMATE = (0.5**2, 0.5**2, 0.0, 0.0, 0.0, (math.pi / 12.0) ** 2)


@dataclass(frozen=True)
class Click:
    """A click on the ground that a page sent."""

    tool: str = parameter(REQUIRED, "the tool", choices=tuple(TOOLS))
    frame: str = parameter(REQUIRED, "the frame of the place", not_empty=True)
    x: float = parameter(REQUIRED, "m")
    y: float = parameter(REQUIRED, "m")
    yaw: float = parameter(REQUIRED, "rad; not used for a point")
    command_topic: str = parameter(REQUIRED, "identifies the robot that it is for")


def message_of(click: Click, stamp: Any) -> Any:
    """Return the message of a click, stamped with a builtin_interfaces/msg/Time."""
    message = TOOLS[click.tool].kind()
    message.header.frame_id, message.header.stamp = click.frame, stamp
    if click.tool == "point":
        message.point.x, message.point.y = click.x, click.y
        return message
    pose = message.pose
    if click.tool == "estimate":
        fill_diagonal(pose.covariance, _ESTIMATE)
        pose = pose.pose
    pose.position.x, pose.position.y = click.x, click.y
    *_, pose.orientation.z, pose.orientation.w = about_z(click.yaw)
    return message


class ToolPublishers:
    """Publishes clicks to the robot that is steered."""

    def __init__(self, node: Node, commands: CommandTopic) -> None:
        self._node, self._commands = node, commands
        self._publishers: dict[str, Any] = {}  # publishers, by full topic name

    def prepare(self) -> None:
        """Create the publishers before the first click, since discovery takes a moment."""
        for tool in TOOLS.values():
            topic = self._topic(tool)
            if topic not in self._publishers:
                self._publishers[topic] = self._node.create_publisher(tool.kind, topic, _DEPTH)

    def publish(self, click: Click) -> tuple[str, int]:
        """Publish a click; return the topic's full name and the number of its subscribers.

        Raises:
            OneBotError: the click is for another robot.
        """
        if click.command_topic != self._commands.topic:
            raise OneBotError("another robot is steered now")
        self.prepare()
        topic = self._topic(TOOLS[click.tool])
        publisher = self._publishers[topic]
        publisher.publish(message_of(click, self._node.get_clock().now().to_msg()))
        return topic, publisher.get_subscription_count()

    def _topic(self, tool: Tool) -> str:
        return f"{namespace_of(self._commands.topic)}/{tool.topic}"
