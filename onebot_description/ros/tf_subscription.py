"""Subscribes to TF: the messages of /tf and /tf_static as arrays."""

from collections.abc import Callable
from functools import partial

from rclpy.node import Node
from rclpy.subscription import Subscription

from onebot_description.ros.topic_qos import make_qos
from onebot_description.ros.wire.interfaces import TFMessage
from onebot_description.ros.wire.message_arrays import BAD_MESSAGE, TfArrays, tf_arrays

_DEPTH = 100  # queue depth, as in tf2's subscriptions; /tf has several publishers


def subscribe_to_tf(
    node: Node,
    received: Callable[[TfArrays, bool], object],
    invalid: Callable[[str], object] | None = None,
) -> list[Subscription]:
    """Subscribe to /tf and /tf_static; return both subscriptions.

    Args:
        node: the subscriber.
        received: called with each message, and whether its transforms are static.
        invalid: called with a sentence for each message that cannot be decoded.
    """

    def receive(topic: str, static: bool, data: bytes) -> None:
        try:
            message = tf_arrays(data)
        except BAD_MESSAGE as error:
            if invalid is not None:
                invalid(f"a message of {topic} is ignored: {error}")
            return
        received(message, static)

    return [
        node.create_subscription(
            TFMessage,
            topic,
            partial(receive, topic, static),
            make_qos(_DEPTH, reliable=True, latched=static),
            raw=True,
        )
        for topic, static in (("/tf", False), ("/tf_static", True))
    ]
