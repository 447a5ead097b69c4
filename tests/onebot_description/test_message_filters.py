"""message_filters: caches, and sets of messages that belong together."""

from typing import Any

import pytest
import rclpy
from message_filters import (
    ApproximateTimeSynchronizer,
    Cache,
    SimpleFilter,
    Subscriber,
    TimeSynchronizer,
)
from rclpy.clock import ROSClock
from rclpy.node import Node
from rclpy.time import Time
from sensor_msgs.msg import Imu
from std_msgs.msg import String

import onebot_description  # noqa: F401  (finds the package)
from tests.ros_support import node_here, spin_until


def stamped(seconds: float, name: str = "") -> Imu:
    message = Imu()
    message.header.stamp = Time(nanoseconds=round(seconds * 1e9)).to_msg()
    message.header.frame_id = name
    return message


def at(seconds: float) -> Time:
    return Time.from_msg(stamped(seconds).header.stamp)


def collected(synchronizer: SimpleFilter) -> list[tuple[str, ...]]:
    sets: list[tuple[str, ...]] = []
    synchronizer.registerCallback(
        lambda *messages: sets.append(tuple(one.header.frame_id for one in messages))
    )
    return sets


def test_messages_of_the_same_stamp() -> None:
    """In the order of the filters, whatever came first; what waits too long is dropped."""
    left, right = SimpleFilter(), SimpleFilter()
    sets = collected(TimeSynchronizer([left, right], 2))
    for seconds in (1.0, 2.0, 3.0):
        right.signalMessage(stamped(seconds, f"r{seconds:g}"))
    for seconds in (1.0, 3.0, 2.0, 2.0):
        left.signalMessage(stamped(seconds, f"l{seconds:g}"))
    assert sets == [("l3", "r3"), ("l2", "r2")]


def test_messages_of_about_the_same_stamp() -> None:
    """The nearest set is passed on, if its stamps differ by less than the slop; each once."""
    first, second, third = (SimpleFilter() for _ in range(3))
    synchronizer = ApproximateTimeSynchronizer([first, second, third], 5, 0.1)
    sets = collected(synchronizer)
    for seconds in (1.0, 1.04, 1.5):
        first.signalMessage(stamped(seconds, f"a{seconds:g}"))
    second.signalMessage(stamped(1.6, "b1.6"))  # 0.1 from 1.5 is not less
    third.signalMessage(stamped(1.05, "c1.05"))
    assert not sets
    second.signalMessage(stamped(1.06, "b1.06"))
    assert sets == [("a1.04", "b1.06", "c1.05")]
    third.signalMessage(stamped(1.02, "c1.02"))
    assert len(sets) == 1 and [len(queue) for queue in synchronizer.queues] == [2, 1, 1]


def test_an_exception_of_a_callback_leaves_the_filter_usable() -> None:
    left, right = SimpleFilter(), SimpleFilter()
    synchronizer = ApproximateTimeSynchronizer([left, right], 5, 0.1)
    sets: list[Any] = []

    def callback(*messages: Any) -> None:
        sets.append(messages)
        raise RuntimeError("once")

    synchronizer.registerCallback(callback)
    for seconds in (1.0, 2.0):
        left.signalMessage(stamped(seconds))
        with pytest.raises(RuntimeError, match="once"):
            right.signalMessage(stamped(seconds))
    assert len(sets) == 2


def test_messages_without_a_stamp(capfd: pytest.CaptureFixture[str]) -> None:
    """They are taken at the time of their arrival if that is allowed; else a warning says why."""
    words, stamps = SimpleFilter(), SimpleFilter()
    refusing = Cache(words, 3)
    allowing = Cache(words, 3, allow_headerless=True)
    pairs: list[Any] = []
    synchronizer = ApproximateTimeSynchronizer([words, stamps], 3, 60.0, allow_headerless=True)
    synchronizer.registerCallback(lambda *pair: pairs.append(pair))
    words.signalMessage(String(data="hello"))
    stamps.signalMessage(stamped(ROSClock().now().nanoseconds / 1e9))
    assert refusing.getLast() is None and allowing.getLast().data == "hello" and len(pairs) == 1
    assert "a String without a stamp is ignored" in capfd.readouterr().err


def test_a_cache() -> None:
    source = SimpleFilter()
    cache = Cache(source, 3)
    seen = collected(cache)
    for seconds in (1.0, 2.0, 3.0, 4.0):
        source.signalMessage(stamped(seconds, f"{seconds:g}"))
    assert seen == [("1",), ("2",), ("3",), ("4",)]

    def names(*messages: Any) -> list[str]:
        return [one.header.frame_id for one in messages]

    one, two, four = (at(seconds) for seconds in (1.0, 2.5, 4.0))
    assert names(*cache.getInterval(one, two)) == ["2"]
    assert names(cache.getElemAfterTime(two), cache.getElemBeforeTime(two)) == ["3", "2"]
    assert cache.getElemBeforeTime(one) is None
    assert (cache.getOldestTime(), cache.getLastestTime()) == (at(2.0), four)


def test_topics(ros_domain: int) -> None:
    """A subscriber takes what create_subscription takes, and has what a subscription has."""
    with node_here("filters") as node:
        assert isinstance(node, Node)
        publisher = node.create_publisher(Imu, "imu", 10)
        subscriber = Subscriber(node, Imu, "imu", qos_profile=rclpy.qos.qos_profile_sensor_data)
        cache = Cache(subscriber, 2)
        assert subscriber.getTopic() == "imu" and subscriber.topic_name == "/imu"

        def received() -> bool:
            publisher.publish(stamped(1.5))
            return cache.getLast() is not None

        spin_until(node, received, "a message")
        assert cache.getLastestTime() == at(1.5)
