"""``TransformBroadcaster``: publishes transforms on the topic /tf."""

from collections.abc import Iterable

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from tf2_msgs.msg import TFMessage


class TransformBroadcaster:
    """Publishes transforms that change.

    Args:
        node: the node that publishes them.
        qos: quality of service; by default the last 100 messages.
    """

    def __init__(self, node: Node, qos: QoSProfile | int | None = None) -> None:
        qos = QoSProfile(depth=100) if qos is None else qos
        self.pub_tf = node.create_publisher(TFMessage, "/tf", qos)

    def sendTransform(  # noqa: N802
        self, transform: TransformStamped | Iterable[TransformStamped]
    ) -> None:
        """Publish one transform, or several in one message."""
        self.pub_tf.publish(TFMessage(transforms=listed(transform)))


def listed(transform: TransformStamped | Iterable[TransformStamped]) -> list[TransformStamped]:
    """Return one or several transforms as a list."""
    return list(transform) if hasattr(transform, "__iter__") else [transform]
