"""Finds and subscribes to the odometry of the robot that is steered."""

import math
from collections.abc import Collection, Mapping
from typing import Any

from onebot_bringup.steering.followed_topics import ODOMETRY, FollowedTopics
from onebot_description.geometry.poses import yaw_of
from onebot_description.ros.names import node_name
from onebot_description.ros.wire.message_arrays import OdometrySample

_NAMES = "/odom", "/odometry"  # endings of the topics of diff_drive_controller and of others


def choose_odometry(
    publishers: Mapping[str, Collection[str]], commands: str, controllers: Collection[str]
) -> str:
    """Return the topic with the robot's odometry; "" if it cannot be determined.

    Args:
        publishers: for each odometry topic, the nodes that publish it.
        commands: the command topic.
        controllers: the nodes known to be the robot's controllers.
    """
    topics = [name for name, nodes in publishers.items() if not set(controllers).isdisjoint(nodes)]
    if len(topics) > 1:  # a simulation publishes the ground truth, too
        topics = [topic for topic in topics if topic.endswith(_NAMES)]
    if len(topics) != 1:
        siblings = [f"{commands.rpartition('/')[0]}{name}" for name in _NAMES]
        topics = [topic for topic in siblings if topic in publishers] or list(publishers)
    return topics[0] if len(topics) == 1 else ""


class OdometryTopic:
    """Subscribes to the robot's odometry."""

    def __init__(self, topics: FollowedTopics, fixed: str) -> None:
        self._node, self._topics, self._fixed = topics.node, topics, fixed
        self.topic = ""  # full name; "" for none

    def needed(self, commands: str, controllers: Collection[str]) -> dict[str, str]:
        """Return the topic to follow, if there is one; call this several times per second.

        See ``choose_odometry`` for the arguments.
        """
        self.topic = self._fixed or choose_odometry(self._publishers(), commands, controllers)
        return {self.topic: ODOMETRY} if self.topic else {}

    @property
    def sample(self) -> OdometrySample | None:
        """The latest odometry; None if there is none, or if it cannot be decoded."""
        sample: OdometrySample | None = self._topics.newest(self.topic).message
        return sample

    @property
    def age(self) -> float:
        """Seconds since the latest odometry was received; infinite if there is none."""
        return self._topics.newest(self.topic).age

    def fields(self) -> dict[str, Any] | None:
        """Return the latest odometry for the page's state: m, rad, m/s, rad/s, and its age in s.

        It is None if there is none, if it cannot be decoded, or if its numbers are not finite.
        """
        sample, age = self.sample, self.age
        if sample is None:
            return None
        values = {
            "x": float(sample.translation[0]),
            "y": float(sample.translation[1]),
            "yaw": yaw_of(*sample.rotation.tolist()),
            "linear": float(sample.linear[0]),
            "angular": float(sample.angular[2]),
            "lateral": float(sample.linear[1]),
            "age": age,
        }
        if not all(map(math.isfinite, values.values())):
            return None
        rounded = {name: round(value, 6) for name, value in values.items()}
        return {"topic": self.topic, **rounded}

    def _publishers(self) -> dict[str, list[str]]:
        find = self._node.get_publishers_info_by_topic
        publishers = {
            name: [node_name(end) for end in find(name)]
            for name, kinds in self._node.get_topic_names_and_types()
            if ODOMETRY in kinds
        }
        return {name: nodes for name, nodes in publishers.items() if nodes}
