"""``StaticTransformBroadcaster``: publishes transforms on the topic /tf_static."""

from collections.abc import Iterable

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage
from tf2_ros.transform_broadcaster import listed


class StaticTransformBroadcaster:
    """Publishes transforms that do not change; later subscribers receive all of them.

    Args:
        node: the node that publishes them.
        qos: quality of service; by default the last message, latched.
    """

    def __init__(self, node: Node, qos: QoSProfile | int | None = None) -> None:
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.pub_tf = node.create_publisher(TFMessage, "/tf_static", qos or latched)
        self.net_message = TFMessage()
        self._child_frame_ids: set[str] = set()

    def sendTransform(  # noqa: N802
        self, transform: TransformStamped | Iterable[TransformStamped]
    ) -> None:
        """Publish one or several transforms, together with the earlier ones.

        As in Jazzy, only the first transform of each frame counts.
        """
        for stamped in listed(transform):
            if stamped.child_frame_id not in self._child_frame_ids:
                self._child_frame_ids.add(stamped.child_frame_id)
                self.net_message.transforms.append(stamped)
        self.pub_tf.publish(self.net_message)
