"""The odometry that the steering page shows."""

import math
import time
from typing import Any

from nav_msgs.msg import Odometry
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from onebot_bringup.raw_messages import odometry_sample
from onebot_control.frames import yaw_of

RCLError = rclpy_implementation.RCLError

_ODOMETRY = "nav_msgs/msg/Odometry"
_LATEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


class OdometryTopic:
    """Hears where the robot is.

    Attributes:
        topic: the one that is heard, in full; "" while there is none.
    """

    def __init__(self, node: Node, fixed: str) -> None:
        """Hear ``fixed``, a name in full, or else ("") what ``look`` finds."""
        self._node, self._fixed = node, fixed
        self._subscription: Any = None
        self._data: tuple[bytes, float] | None = None
        self.topic = ""

    def look(self, commands: str) -> None:
        """Follow the robot that takes ``commands``; to be called some times a second.

        Its odometry is the sibling "odom" of that topic, or else the only Odometry there is.
        """
        wanted = self._fixed or self._found(commands)
        if wanted == self.topic:
            return
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription, self.topic, self._data = None, "", None
        elif wanted:
            try:
                self._subscription = self._node.create_subscription(
                    Odometry, wanted, self._hear, _LATEST, raw=True
                )
            except RCLError:
                return  # it has another type; it may have the right one later
            self.topic = wanted

    def fields(self) -> dict[str, Any] | None:
        """Return the latest as the page's state has it: m, rad, m/s, rad/s, and its age in s.

        None if there is none, if it cannot be decoded, or if its numbers are not finite.
        """
        data = self._data
        if data is None:
            return None
        try:
            sample = odometry_sample(data[0])
        except ValueError:
            return None
        values = {
            "x": float(sample.translation[0]),
            "y": float(sample.translation[1]),
            "yaw": yaw_of(*sample.rotation.tolist()),
            "linear": float(sample.linear[0]),
            "angular": float(sample.angular[2]),
            "age": time.monotonic() - data[1],
        }
        if not all(map(math.isfinite, values.values())):
            return None
        rounded = {name: round(value, 6) for name, value in values.items()}
        return {"topic": self.topic, **rounded}

    def _hear(self, data: bytes) -> None:
        self._data = data, time.monotonic()

    def _found(self, commands: str) -> str:
        known = [
            name
            for name, kinds in self._node.get_topic_names_and_types()
            if _ODOMETRY in kinds and self._node.count_publishers(name)
        ]
        sibling = f"{commands.rpartition('/')[0]}/odom"
        return sibling if sibling in known else known[0] if len(known) == 1 else ""
