"""Stops publishing ground truth on TF when another node localizes the robot (REP-105).

A frame has only one parent in TF. If a localizer such as AMCL or slam_toolbox publishes the parent
of odom, the simulation no longer publishes the true one.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

from onebot_control.nodes.publishing import Publishers
from onebot_description.geometry.poses import of_arrays
from onebot_description.ros.topic_qos import make_qos
from onebot_description.ros.wire.interfaces import TFMessage
from onebot_description.ros.wire.message_arrays import BAD_MESSAGE, tf_arrays

_TOPICS = {"/tf": False, "/tf_static": True}  # whether each is latched
# Messages kept between two polls; localizers repeat lost ones. With ten polls per second it limits
# the load: 1,000 messages, of 17 us each, are 2 % of a core.
_DEPTH = 100


class LocalizerWatch:
    """Detects localizers of all robots of a world.

    It polls, because an executor would wake up for each transform of all robots.
    """

    def __init__(self, nodes: Sequence[Node], robots: Sequence[Publishers]) -> None:
        """Prepare; ``poll`` subscribes.

        Args:
            nodes: nodes of the robots, whose own publishers are ignored.
            robots: the publishers of ground truth.
        """
        self._nodes, self._all_robots = nodes, robots
        self._robots: Mapping[str, Publishers] = {}  # robots with ground truth on TF, by odom frame
        self._subscriptions: list[Any] = []

    def poll(self) -> None:
        """Look for localizers; call it several times per second while the control loop runs."""
        robots = {
            robot.odom_frame: robot
            for robot in self._all_robots
            if robot.odom_frame and robot.publishes_truth
        }
        if robots.keys() != self._robots.keys():
            # New subscriptions receive the latched transforms again.
            for subscription in self._subscriptions:
                subscription.destroy_when_not_in_use()
            self._subscriptions = []
        self._robots = robots
        for subscription in self._subscriptions:
            while message := subscription.take_message(TFMessage, True):
                self._receive(message[0])
        # Last, because a latched message arrives at some time after this: in lockstep, it is
        # awaited between two polls.
        if robots and not self._subscriptions and self._others_publish():
            self._subscriptions = [self._subscribed(*topic) for topic in _TOPICS.items()]

    def _receive(self, data: bytes) -> None:
        try:
            message = tf_arrays(data)
        except BAD_MESSAGE:
            return
        for row, (parent, odom) in enumerate(zip(message.parents, message.children, strict=True)):
            if (robot := self._robots.get(odom)) is not None and not robot.localized:
                pose = of_arrays(message.translations[row], message.rotations[row])
                if (parent, int(message.stamps_ns[row]), pose) not in robot.truths:
                    robot.give_way(f"{parent} -> {odom}")

    def _others_publish(self) -> bool:
        node = self._nodes[0]
        own_topics = [end.topic_name for each_node in self._nodes for end in each_node.publishers]
        return any(node.count_publishers(topic) > own_topics.count(topic) for topic in _TOPICS)

    def _subscribed(self, topic: str, latched: bool) -> Any:
        # Created without the node, so that its executor does not wait for it.
        node, qos = self._nodes[0], make_qos(_DEPTH, reliable=latched, latched=latched)
        with node.handle:
            return rclpy_implementation.Subscription(
                node.handle, TFMessage, topic, qos.get_c_qos_profile()
            )
