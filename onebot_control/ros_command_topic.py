"""~/cmd_vel, as Twist or as TwistStamped, whichever is published.

One DDS participant refuses two types on one topic (Fast DDS: "called for existing topic name with
incompatible type"), so there can be no two subscriptions in a node. A second participant works, but
then the topic has two types for good, and every tool that finds a topic's type out by itself (topic
echo, hz, info, bag) refuses it. So this subscribes to one type, and changes over when only the
other one is published.
"""

from collections.abc import Callable

from geometry_msgs.msg import Twist, TwistStamped
from rclpy.node import Node
from rclpy.subscription import Subscription

from onebot_description.stamps import nanoseconds

_TOPIC = "~/cmd_vel"
_DEPTH = 10  # ROS's system default
_TYPES = {"Twist": Twist, "TwistStamped": TwistStamped}
_NAMES = {f"geometry_msgs/msg/{name}": name for name in _TYPES}


class CommandTopic:
    """Hears commands of either type.

    Attributes:
        kind: the type subscribed to, "Twist" or "TwistStamped".
    """

    def __init__(
        self,
        node: Node,
        choice: str,
        heard: Callable[[float, float, int | None], None],
        warn: Callable[[str, str], None],
    ) -> None:
        """Subscribe.

        Args:
            node: of which ~/cmd_vel is.
            choice: "Twist", "TwistStamped", or "auto" to follow the publishers.
            heard: called with linear.x in m/s, angular.z in rad/s, and the stamp in ns (None for a
                Twist, which has none).
            warn: called with a key and a text to warn of.
        """
        self._node, self._heard, self._warn = node, heard, warn
        self.kind = ""
        self._subscription: Subscription | None = None
        self._choice = choice
        self._wanted = "Twist" if choice == "auto" else choice
        self._subscribe(self._wanted)

    def choose(self, choice: str) -> None:
        """Change over to another choice (see the constructor); with the next ``follow``."""
        self._choice = choice
        if choice not in ("auto", self._wanted):
            self._wanted = choice
            self._leave()

    def follow(self) -> None:
        """Look at who publishes, and change over if it is only the other type.

        To be called several times a second.
        """
        if self._subscription is None:
            self._subscribe(self._wanted)
            return
        infos = self._node.get_publishers_info_by_topic(self._node.resolve_topic_name(_TOPIC))
        kinds = {info.topic_type for info in infos}
        published = {_NAMES[kind] for kind in kinds if kind in _NAMES}
        if self._choice == "auto" and published and self.kind not in published:
            self._wanted = published.pop()
            self._leave()
            return
        ignored = sorted(kinds - {f"geometry_msgs/msg/{self.kind}"})
        if ignored:
            hint = "" if self._choice == "auto" else f" (cmd_vel_type is {self._choice})"
            text = f"{_TOPIC} is also published as {', '.join(ignored)}, which is ignored{hint}"
            self._warn("type", f"{text}; {self.kind} is heard")

    def _leave(self) -> None:
        """Give up the subscription; a new one of this name can only be made once it is gone.

        The executor lets go of it after the callback this is called from, so not before then.
        """
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None

    def _subscribe(self, kind: str) -> None:
        callback = self._on_twist if kind == "Twist" else self._on_stamped
        self._subscription = self._node.create_subscription(_TYPES[kind], _TOPIC, callback, _DEPTH)
        if self.kind:
            self._node.get_logger().info(f"commands are {kind} now")
        self.kind = kind

    def _on_twist(self, message: Twist) -> None:
        self._heard(message.linear.x, message.angular.z, None)

    def _on_stamped(self, message: TwistStamped) -> None:
        twist = message.twist
        self._heard(twist.linear.x, twist.angular.z, nanoseconds(message.header.stamp))
