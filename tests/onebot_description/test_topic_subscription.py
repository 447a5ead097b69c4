"""Type and QoS by the publishers of a topic, and the subscription that changes with them."""

from collections.abc import Callable, Iterator
from queue import SimpleQueue
from typing import Any

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Int32, String

from onebot_description.ros.topic_qos import compatible_qos, exceeds
from onebot_description.ros.topic_subscription import (
    TopicSubscription,
    TypeConflictError,
    choose_type,
    offers,
)
from tests.ros_support import Peer
from tests.support import wait_for

STRING, INT32 = "std_msgs/msg/String", "std_msgs/msg/Int32"
CLASSES = {STRING: String, INT32: Int32}
DEFAULT = QoSProfile(depth=10)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_EFFORT = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)


@pytest.mark.parametrize(
    ("offered", "current", "chosen"),
    [([], None, None), (["b", "a"], None, "a"), (["b", "a"], "b", "b"), (["a"], "b", "a")],
)
def test_the_current_type_is_kept_while_it_is_offered(offered, current, chosen):
    assert choose_type(offered, current) == chosen


@pytest.mark.parametrize(
    ("offered", "reliable", "latched"),
    [
        ([], True, False),
        ([DEFAULT], True, False),
        ([LATCHED, LATCHED], True, True),
        ([LATCHED, DEFAULT], True, False),
        ([DEFAULT, BEST_EFFORT], False, False),
    ],
)
def test_the_qos_receives_from_all_publishers(offered, reliable, latched):
    qos = compatible_qos(offered, 7)
    assert qos.depth == 7
    assert (qos.reliability == ReliabilityPolicy.RELIABLE) is reliable
    assert (qos.durability == DurabilityPolicy.TRANSIENT_LOCAL) is latched


def test_a_stricter_request_exceeds():
    assert exceeds(LATCHED, DEFAULT) and exceeds(DEFAULT, BEST_EFFORT)
    assert not exceeds(BEST_EFFORT, LATCHED) and not exceeds(DEFAULT, LATCHED)


class Subscriber:
    """A node whose timer runs jobs, each in a callback of its own."""

    def __init__(self, domain: int) -> None:
        self.peer = Peer(domain, "subscriber")
        self.received: list[tuple[str, Any]] = []
        self._jobs: SimpleQueue[Callable[[], object]] = SimpleQueue()

    def start(self) -> TopicSubscription:
        self.peer.node.create_timer(0.01, self._run)
        received = lambda kind, message: self.received.append((kind, message.data))  # noqa: E731
        return TopicSubscription(self.peer.node, "/topic", received, CLASSES.__getitem__, raw=False)

    def run(self, job: Callable[[], object]) -> Any:
        """Run ``job`` in a callback; its value, or the TypeConflictError that it raised."""
        results: list[object] = []

        def guarded() -> None:
            try:
                results.append(job())
            except TypeConflictError as error:
                results.append(error)

        self._jobs.put(guarded)
        wait_for(lambda: results, "the callback")
        return results[0]

    def _run(self) -> None:
        if not self._jobs.empty():
            self._jobs.get()()


@pytest.fixture
def subscriber(ros_domain: int) -> Iterator[Subscriber]:
    subscriber = Subscriber(ros_domain)
    with subscriber.peer:
        yield subscriber


def test_offers_are_the_publishers_or_else_other_nodes_subscriptions(ros_domain, subscriber):
    node = subscriber.peer.node
    subscriber.start().update(STRING, DEFAULT)
    assert offers(node, "/topic") == {}
    with Peer(ros_domain, "other") as other:
        other.node.create_subscription(Int32, "/topic", print, 10)
        wait_for(lambda: offers(node, "/topic") == {INT32: []}, "the other subscription")
        other.node.create_publisher(String, "/topic2", BEST_EFFORT)
        wait_for(lambda: list(offers(node, "/topic2")) == [STRING], "the publisher")
        (qos,) = offers(node, "/topic2")[STRING]
        assert qos.reliability == ReliabilityPolicy.BEST_EFFORT
        assert offers(node, "/topic2", [INT32]) == {}


def test_a_change_of_type_takes_two_updates_and_of_qos_one(ros_domain, subscriber):
    topic = subscriber.start()
    for _ in range(3):
        for kind in (STRING, INT32):
            first = subscriber.run(lambda: topic.update(kind, DEFAULT))  # noqa: B023
            assert first is None
            subscriber.run(lambda: topic.update(kind, DEFAULT))  # noqa: B023
            assert topic.type == kind
    subscriber.run(lambda: topic.update(INT32, BEST_EFFORT))
    assert (topic.type, topic.qos) == (INT32, BEST_EFFORT)
    with Peer(ros_domain, "sender") as sender:
        publisher = sender.node.create_publisher(Int32, "/topic", BEST_EFFORT)

        def arrived() -> bool:
            publisher.publish(Int32(data=3))
            return bool(subscriber.received)

        wait_for(arrived, "a message")
    assert subscriber.received[0] == (INT32, 3)


def test_a_topic_held_as_another_type_is_refused_until_it_is_free(subscriber):
    topic = subscriber.start()
    holder = subscriber.run(
        lambda: subscriber.peer.node.create_subscription(Int32, "/topic", print, 10)
    )
    refused = subscriber.run(lambda: topic.update(STRING, DEFAULT))
    assert isinstance(refused, TypeConflictError)
    assert 'topic "/topic" cannot be subscribed as std_msgs/msg/String' in str(refused)
    assert topic.type is None
    subscriber.run(lambda: subscriber.peer.node.destroy_subscription(holder))
    assert subscriber.run(lambda: topic.update(STRING, DEFAULT)) is None
    assert topic.type == STRING
