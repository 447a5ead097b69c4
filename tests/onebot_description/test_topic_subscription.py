"""Type and QoS by the publishers of a topic, and the subscription that changes with them."""

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


@pytest.fixture
def received() -> list[tuple[str, Any]]:
    """What the subscription receives: types and data."""
    return []


@pytest.fixture
def topic(peer: Peer, received: list[tuple[str, Any]]) -> TopicSubscription:
    """The subscription of a node, which ``peer.run`` changes in a callback of its own."""
    note = lambda kind, message: received.append((kind, message.data))  # noqa: E731
    return TopicSubscription(peer.node, "/topic", note, CLASSES.__getitem__, raw=False)


def test_offers_are_the_publishers_or_else_other_nodes_subscriptions(ros_domain, peer, topic):
    node = peer.node
    peer.run(topic.update, STRING, DEFAULT)
    with Peer(ros_domain, "other") as other:
        other.node.create_subscription(Int32, "/topic", print, 10)
        wait_for(lambda: offers(node, "/topic") == {INT32: []}, "the other subscription")
        other.node.create_publisher(String, "/topic2", BEST_EFFORT)
        wait_for(lambda: list(offers(node, "/topic2")) == [STRING], "the publisher")
        (qos,) = offers(node, "/topic2")[STRING]
        assert qos.reliability == ReliabilityPolicy.BEST_EFFORT
        assert offers(node, "/topic2", [INT32]) == {}


def test_a_change_of_type_takes_two_updates_and_of_qos_one(ros_domain, peer, topic, received):
    for _ in range(3):
        for kind in (STRING, INT32):
            for _ in range(2):
                peer.run(topic.update, kind, DEFAULT)
            assert topic.type == kind
    peer.run(topic.update, INT32, BEST_EFFORT)
    assert (topic.type, topic.qos) == (INT32, BEST_EFFORT)
    with Peer(ros_domain, "sender") as sender:
        publisher = sender.node.create_publisher(Int32, "/topic", BEST_EFFORT)
        wait_for(lambda: publisher.publish(Int32(data=3)) or received, "a message")
    assert received[0] == (INT32, 3)


def test_a_topic_held_as_another_type_is_refused_until_it_is_free(peer, topic):
    holder = peer.run(peer.node.create_subscription, Int32, "/topic", print, 10)

    def refusal() -> str:
        with pytest.raises(TypeConflictError) as caught:
            topic.update(STRING, DEFAULT)
        return str(caught.value)

    assert 'cannot subscribe to topic "/topic" with type std_msgs/msg/String' in peer.run(refusal)
    assert topic.type is None
    peer.run(peer.node.destroy_subscription, holder)
    peer.run(topic.update, STRING, DEFAULT)
    assert topic.type == STRING
