"""The parameters of the steering page's node, declared, read and checked."""

import math
from dataclasses import dataclass

from rcl_interfaces.msg import ParameterDescriptor
from rclpy.node import Node

from onebot_bringup.steering.protocol import Velocity
from onebot_description.errors import OneBotError

USUAL = Velocity(1.0, 2.0)  # limits where nobody says any
_LEAST_RATE, _MOST_RATE = 5.0, 100.0  # Hz

_DECLARED: dict[str, tuple[str | int | float | bool, str]] = {
    "host": ("127.0.0.1", "where the page is served; 0.0.0.0: to other computers, too"),
    "port": (8080, "another if it is in use, 0 for any"),
    "token": ("", "asked for in the page's address; made anew where one is needed"),
    "topic": ("velocity_controller/cmd_vel", "to steer, Twist or TwistStamped"),
    "odom_topic": ("", 'Odometry to show; "" for the robot\'s own'),
    "rate": (20.0, "of the commands, Hz"),
    "max_linear": (0.0, "m/s; 0.0 for the controller's"),
    "max_angular": (0.0, "rad/s; 0.0 for the controller's"),
    "viewer_page": ("rerun_viewer/page", "the topic that says where the view is"),
    "open_browser": (True, "open the page, if there is a display"),
}


@dataclass(frozen=True)
class SteeringParameters:
    """The values; topics are full names, "" for none.

    Attributes:
        host, port, token: where the page is served, and what its address must hold.
        topic: to steer at first.
        odom_topic: to show; "" for the robot's own.
        rate: of the commands, Hz.
        fixed: the most that pages can ask for, m/s and rad/s; 0 for the controller's.
        viewer_page: the topic that says where the view is.
        open_browser: open the page.
    """

    host: str
    port: int
    token: str
    topic: str
    odom_topic: str
    rate: float
    fixed: Velocity
    viewer_page: str
    open_browser: bool

    @classmethod
    def of(cls, node: Node) -> "SteeringParameters":
        """Declare them on ``node`` and return what they are.

        Raises:
            OneBotError: one is wrong.
        """
        for name, (default, meaning) in _DECLARED.items():
            descriptor = ParameterDescriptor(description=meaning, read_only=True)
            node.declare_parameter(name, default, descriptor)
        fixed = Velocity(_number(node, "max_linear"), _number(node, "max_angular"))
        rate = _number(node, "rate")
        if not _LEAST_RATE <= rate <= _MOST_RATE:
            raise OneBotError(f"rate:={rate:g}: write Hz from {_LEAST_RATE:g} to {_MOST_RATE:g}")
        if not _text(node, "topic"):
            raise OneBotError("topic:= must not be empty: name the topic to steer")
        return cls(
            host=_text(node, "host"),
            port=int(node.get_parameter("port").value),
            token=_text(node, "token"),
            topic=_topic(node, "topic"),
            odom_topic=_topic(node, "odom_topic"),
            rate=rate,
            fixed=fixed,
            viewer_page=_topic(node, "viewer_page"),
            open_browser=bool(node.get_parameter("open_browser").value),
        )

    @property
    def ceiling(self) -> Velocity:
        """The most that pages can set as limits."""
        return Velocity(self.fixed.linear or math.inf, self.fixed.angular or math.inf)

    def limits(self, found: Velocity = USUAL) -> Velocity:
        """Return the limits to begin with: as fixed, or else as found, or else the usual ones.

        Args:
            found: the controller's, m/s and rad/s; nan where it has none.
        """
        return Velocity(
            self.fixed.linear or (USUAL.linear if math.isnan(found.linear) else found.linear),
            self.fixed.angular or (USUAL.angular if math.isnan(found.angular) else found.angular),
        )


def _text(node: Node, name: str) -> str:
    return str(node.get_parameter(name).value)


def _number(node: Node, name: str) -> float:
    value = float(node.get_parameter(name).value)
    if not 0.0 <= value < math.inf:
        raise OneBotError(f"{name}:={value:g}: write a number from 0.0 on")
    return value


def _topic(node: Node, name: str) -> str:
    text = _text(node, name)
    try:
        return str(node.resolve_topic_name(text)) if text else ""
    except Exception as error:  # rclpy raises several kinds, none of them public
        reason = " ".join(str(error).split("\n")[0].split())
        raise OneBotError(f"{name}:={text} is no name of a topic: {reason}") from None
