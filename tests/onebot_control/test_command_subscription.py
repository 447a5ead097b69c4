"""~/cmd_vel of either type: which one is subscribed to, on real DDS."""

import time
from collections.abc import Callable, Iterator
from queue import SimpleQueue
from typing import Any

import pytest
from geometry_msgs.msg import Twist, TwistStamped

from onebot_control.nodes.commands import Command, CommandSubscription
from tests.ros_support import Peer
from tests.support import wait_for

TOPIC = "/driver/cmd_vel"


class Driver:
    """A node with a CommandSubscription that looks at its publishers every 20 ms."""

    def __init__(self, domain: int) -> None:
        self.peer = Peer(domain, "driver")
        self.looks = 0
        self.commands: list[Command] = []
        self.warnings: list[tuple[str, str]] = []
        self._jobs: SimpleQueue[Callable[[], object]] = SimpleQueue()
        self.topic: CommandSubscription

    def start(self, choice: str) -> None:
        self.topic = CommandSubscription(
            self.peer.node,
            choice,
            self.commands.append,
            lambda *warning: self.warnings.append(warning),
        )
        self.peer.node.create_timer(0.02, self._look)

    def choose(self, choice: str) -> None:
        """As the node does: in a callback of its own."""
        self._jobs.put(lambda: self.topic.choose(choice))

    def look_again(self, times: int = 5) -> None:
        goal = self.looks + times
        wait_for(lambda: self.looks >= goal, "looks at the publishers")

    def _look(self) -> None:
        while not self._jobs.empty():
            self._jobs.get()()
        self.topic.follow()
        self.looks += 1


@pytest.fixture
def driver(ros_domain: int) -> Iterator[Driver]:
    driver = Driver(ros_domain)
    with driver.peer:
        yield driver


def send(publisher: Any, message: Any, driver: Driver) -> Command:
    """Publish until something comes; the last of what came."""
    count = len(driver.commands)

    def arrived() -> bool:
        publisher.publish(message)
        return len(driver.commands) > count

    wait_for(arrived, "a command")
    return driver.commands[-1]


def stamped() -> TwistStamped:
    message = TwistStamped()
    message.twist.linear.x, message.twist.angular.z = 0.3, -0.4
    message.header.stamp.sec, message.header.stamp.nanosec = 7, 8
    return message


def test_a_fixed_type_follows_nobody(driver: Driver, peer: Peer) -> None:
    """The other type is warned of, and only a choice changes the subscription, at once."""
    driver.start("Twist")
    publisher = peer.node.create_publisher(TwistStamped, TOPIC, 10)
    wait_for(lambda: driver.warnings, "the warning of the other type")
    key, text = driver.warnings[0]
    assert (key, driver.topic.kind) == ("type", "Twist")
    assert "TwistStamped, which is ignored (cmd_vel_type is Twist); Twist is subscribed" in text
    driver.look_again()
    assert driver.topic.kind == "Twist"
    driver.choose("TwistStamped")
    assert send(publisher, stamped(), driver)[:3] == (0.3, -0.4, 7_000_000_008)
    driver.choose("auto")
    driver.look_again()
    assert driver.topic.kind == "TwistStamped"


def test_commands_on_cmd_vel_are_reported_if_nobody_receives_them(
    driver: Driver, peer: Peer
) -> None:
    """Once, with the topic that is meant; a node that relays them is enough."""
    relay = peer.node.create_subscription(Twist, "/cmd_vel", lambda _: None, 10)
    peer.node.create_publisher(Twist, "/cmd_vel", 10)
    driver.start("auto")
    wait_for(lambda: driver.peer.node.count_subscribers("/cmd_vel"), "the relay")
    start = time.monotonic()
    wait_for(lambda: time.monotonic() > start + 2.5, "a time in which it would be reported")
    assert driver.warnings == []
    peer.destroy(peer.node.destroy_subscription, relay)
    wait_for(lambda: driver.warnings, "the warning")
    driver.look_again()
    ((_, text),) = driver.warnings
    assert text == (
        "/cmd_vel is published, but no node subscribes to it: "
        "the topic of this robot's commands is /driver/cmd_vel"
    )
