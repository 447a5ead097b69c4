"""``TransformListener``: fills a buffer from the topics /tf and /tf_static."""

from contextlib import suppress
from threading import Thread

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage

_AUTHORITY = "default_authority"
_QOS = QoSProfile(depth=100)
_STATIC_QOS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class ListenerExecutor(SingleThreadedExecutor):
    """Runs a node in the listener's thread.

    Attributes:
        only_listens: marks it for OneBot's lockstep, which runs the node instead.
    """

    only_listens = True


class TransformListener:
    """Receives transforms, and adds them to a buffer.

    Args:
        buffer: the buffer to fill.
        node: the node that receives them.
        spin_thread: whether its own thread runs the callbacks of the node.
        qos: quality of service for /tf; by default the last 100 messages.
        static_qos: quality of service for /tf_static; by default the last 100 messages, latched.
    """

    def __init__(self, buffer, node, *, spin_thread=False, qos=None, static_qos=None) -> None:
        self.buffer, self.node = buffer, node
        # Reentrant, so that transforms arrive while another callback of the node waits for them.
        self.group = ReentrantCallbackGroup()
        self.tf_sub = node.create_subscription(
            TFMessage, "/tf", self.callback, qos or _QOS, callback_group=self.group
        )
        self.tf_static_sub = node.create_subscription(
            TFMessage,
            "/tf_static",
            self.static_callback,
            static_qos or _STATIC_QOS,
            callback_group=self.group,
        )
        if spin_thread:
            self.executor = ListenerExecutor(context=node.context)
            self.executor.add_node(node)
            self.dedicated_listener_thread = Thread(target=_spin, args=(self.executor,))
            self.dedicated_listener_thread.start()

    def __del__(self) -> None:
        if hasattr(self, "dedicated_listener_thread"):
            self.executor.shutdown()
            self.dedicated_listener_thread.join()
        with suppress(AttributeError):  # creating the subscriptions may have failed
            self.unregister()

    def unregister(self) -> None:
        """Destroy the subscriptions."""
        self.node.destroy_subscription(self.tf_sub)
        self.node.destroy_subscription(self.tf_static_sub)

    def callback(self, data: TFMessage) -> None:
        """Add the transforms of a message of /tf."""
        for transform in data.transforms:
            self.buffer.set_transform(transform, _AUTHORITY)

    def static_callback(self, data: TFMessage) -> None:
        """Add the transforms of a message of /tf_static."""
        for transform in data.transforms:
            self.buffer.set_transform_static(transform, _AUTHORITY)


def _spin(executor: ListenerExecutor) -> None:
    with suppress(ExternalShutdownException):
        executor.spin()
