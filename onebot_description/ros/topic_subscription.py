"""Subscribes to a topic whose type and QoS are only known from its publishers."""

from collections.abc import Callable, Collection, Mapping
from functools import partial
from inspect import Parameter, Signature
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from onebot_description.errors import OneBotError
from onebot_description.ros.message_age import Delivery
from onebot_description.ros.names import node_name

RCLError = rclpy_implementation.RCLError


class TypeConflictError(OneBotError):
    """The node already uses the topic with another type."""


def choose_type(offered: Collection[str], current: str | None = None) -> str | None:
    """Return the current type while it is offered, otherwise the first one by name, or None."""
    return current if current in offered else min(offered, default=None)


def offers(
    node: Node, topic: str, accepted: Collection[str] | None = None
) -> Mapping[str, list[QoSProfile]]:
    """Return the types of a topic, and the QoS that its publishers offer for each.

    While there is no publisher, the types are those of other nodes' subscriptions, without offers,
    so that an early subscription does not miss the first messages.

    Args:
        node: the node that queries the graph.
        topic: full name.
        accepted: only these types count; None for all.
    """
    offered: dict[str, list[QoSProfile]] = {}
    for end in node.get_publishers_info_by_topic(topic):
        offered.setdefault(end.topic_type, []).append(end.qos_profile)
    publishers = {
        kind: qos for kind, qos in offered.items() if accepted is None or kind in accepted
    }
    if publishers:
        return publishers
    own_name = node.get_fully_qualified_name()
    ends = node.get_subscriptions_info_by_topic(topic)
    types = {end.topic_type for end in ends if node_name(end) != own_name}
    return {kind: [] for kind in types if accepted is None or kind in accepted}


class TopicSubscription:
    """A subscription whose type and QoS can change.

    A node can use a topic with only one type, and the executor releases a subscription some time
    after the callback that destroys it. A change of type therefore takes two calls of ``update``
    from two callbacks, or more after a TypeConflictError; a change of QoS takes one call.
    """

    type: str | None = None  # subscribed to; None while there is no subscription
    qos: QoSProfile | None = None

    def __init__(
        self,
        node: Node,
        topic: str,
        received: Callable[[str, Any], None],
        message_class: Callable[[str], Any],
        *,
        raw: bool = True,
        lost: Callable[[int], None] | None = None,
        delivered: Callable[[Delivery], None] | None = None,
    ) -> None:
        """Prepare; ``update`` subscribes.

        Args:
            node: the subscriber.
            topic: a name.
            received: called with the type and the message, which is bytes if ``raw``.
            message_class: returns the Python class of a type such as "std_msgs/msg/String".
            raw: receive messages as bytes.
            lost: called with the number of messages that DDS lost.
            delivered: called before ``received`` with the times that DDS reports.
        """
        self._node, self._topic, self._delivered = node, topic, delivered
        self._received, self._message_class, self._raw = received, message_class, raw
        on_lost = (lambda status: lost(status.total_count_change)) if lost else None
        self._events = SubscriptionEventCallbacks(message_lost=on_lost)
        self._subscription: Subscription | None = None

    def update(self, kind: str, qos: QoSProfile) -> None:
        """Create or change the subscription; call it several times a second.

        Raises:
            TypeConflictError: the node still uses the topic with another type.
        """
        if (kind, qos) == (self.type, self.qos):
            return
        waits = self.type not in (None, kind)
        self.close()
        if not waits:
            self._subscribe(kind, qos)

    @property
    def publishers(self) -> int:
        """Number of connected publishers."""
        return self._subscription.get_publisher_count() if self._subscription is not None else 0

    def close(self) -> None:
        """Destroy the subscription, if there is one; ``update`` creates a new one."""
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
        self._subscription = self.type = self.qos = None

    def _subscribe(self, kind: str, qos: QoSProfile) -> None:
        received: Callable[..., None] = partial(self._receive, kind)
        if self._delivered is not None:
            received = _WithInfo(received)
        try:
            self._subscription = self._node.create_subscription(
                self._message_class(kind),
                self._topic,
                received,
                qos,
                event_callbacks=self._events,
                raw=self._raw,
            )
        except RCLError as error:
            raise TypeConflictError(
                f'cannot subscribe to topic "{self._topic}" with type {kind}: '
                f"{self._node.get_name()} has subscribed to it with another type"
            ) from error
        self.type, self.qos = kind, qos

    def _receive(self, kind: str, message: Any, info: Mapping[str, Any] | None = None) -> None:
        if kind != self.type:
            return  # it was in flight when the subscription was closed
        if self._delivered is not None and info is not None:
            self._delivered(Delivery.from_info(info))
        self._received(kind, message)


class _WithInfo:
    """A callback that rclpy calls with a message and its info.

    Executors pass two arguments, but the events executor passes a tuple of both.
    """

    __signature__ = Signature(
        [Parameter(name, Parameter.POSITIONAL_ONLY) for name in ("message", "info")]
    )

    def __init__(self, receive: Callable[..., None]) -> None:
        self._receive = receive

    def __call__(self, *taken: Any) -> None:
        self._receive(*(taken[0] if len(taken) == 1 else taken))
