"""Prints when the first message of each topic is received; a process of its own.

``python -m tests.benchmarks.listener TOPIC:PACKAGE/TYPE ...`` prints a line of JSON once it has
subscribed (``{"ready": true}``), and one for the first message of each topic and child frame:
``{"topic": ..., "at": ..., "frames": [[parent, child], ...], "finite": ...}``. ``at`` is the
system's monotonic clock, in seconds, which is the same in all processes. It ends with its input.
"""

import json
import math
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import rclpy
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from onebot_description.description.packages import use_environment_prefix
from onebot_description.discovery import configure_discovery
from onebot_description.wire.tf_message import TFMessage

_TYPES = {"nav_msgs/Odometry": Odometry, "tf2_msgs/TFMessage": TFMessage}
_QOS = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
_LOOK_EVERY = 0.5  # s, between looks whether the input has ended


class Listener:
    """Prints the first message of each topic."""

    def __init__(self, node: Node, topics: list[str]) -> None:
        self._told: set[tuple[str, str]] = set()
        self.subscriptions = [
            node.create_subscription(
                _TYPES[kind], topic, self._teller(topic, _TYPES[kind]), _QOS, raw=True
            )
            for topic, kind in (words.split(":") for words in topics)
        ]

    def _teller(self, topic: str, kind: Any) -> Any:
        def hear(data: bytes) -> None:
            now = time.monotonic()
            frames = []
            finite = True
            for parent, child, numbers in _frames(deserialize_message(data, kind)):
                finite = finite and all(map(math.isfinite, numbers))
                if (topic, child) not in self._told:
                    self._told.add((topic, child))
                    frames.append((parent, child))
            if frames or not finite:
                _say({"topic": topic, "at": now, "frames": frames, "finite": finite})

        return hear


def _frames(message: Any) -> Iterator[tuple[str, str, list[float]]]:
    """Parent, child and numbers of each transform in a message."""
    if isinstance(message, Odometry):
        pose, q = message.pose.pose.position, message.pose.pose.orientation
        numbers = [pose.x, pose.y, pose.z, q.x, q.y, q.z, q.w]
        yield message.header.frame_id, message.child_frame_id, numbers
        return
    for item in message.transforms:
        shift, q = item.transform.translation, item.transform.rotation
        numbers = [shift.x, shift.y, shift.z, q.x, q.y, q.z, q.w]
        yield item.header.frame_id, item.child_frame_id, numbers


def _say(content: dict[str, Any]) -> None:
    print(json.dumps(content), flush=True)


def main(topics: list[str]) -> None:
    """Listen until standard input ends."""
    use_environment_prefix()
    configure_discovery()
    rclpy.init(args=[])
    node = rclpy.create_node("benchmark_listener")
    listener = Listener(node, topics)
    ended = threading.Event()

    def wait_for_end() -> None:
        sys.stdin.read()
        ended.set()

    threading.Thread(target=wait_for_end, daemon=True).start()
    executor = EventsExecutor()
    executor.add_node(node)
    _say({"ready": bool(listener.subscriptions)})
    try:
        while not ended.is_set():
            executor.spin_once(_LOOK_EVERY)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    executor.remove_node(node)
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main(sys.argv[1:])
