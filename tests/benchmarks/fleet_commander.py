"""Commands the robots of a fleet and counts their cycles; a process of its own.

``python -m tests.benchmarks.fleet_commander NAME ...`` with the robots' names. A line of JSON on
standard input, ``{"seconds": ..., "speed": ...}``, makes it command that speed (m/s) for so long.
It is answered by ``{"stamps": [...], "speeds": {...}, "placed": {...}}``: the stamps (s) of the
joint states of the last robot meanwhile, then the speed of each by its odometry, and where it is.
The first line it prints, ``[]``, means that it has found all robots. It ends with its input.
"""

import json
import sys
import threading
import time
from typing import Any

import rclpy
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException
from sensor_msgs.msg import JointState

from onebot_description.description.packages import use_environment_prefix
from onebot_description.discovery import configure_discovery

_PERIOD = 0.1  # s between commands; a fifth of cmd_vel_timeout


class Commander:
    """A node that commands all robots."""

    def __init__(self, names: list[str]) -> None:
        self._node, self._names = rclpy.create_node("commander"), names
        topics = {name: f"/{name}/velocity_controller" for name in names}
        create = self._node.create_publisher
        self._publishers = [create(Twist, f"{topic}/cmd_vel", 10) for topic in topics.values()]
        self._topics = topics
        self._stamps: list[float] = []
        self._node.create_subscription(JointState, f"/{names[-1]}/joint_states", self._count, 100)
        threading.Thread(target=self._spin, daemon=True).start()
        while not all(each.get_subscription_count() for each in self._publishers):
            time.sleep(0.02)

    def command(self, seconds: float, speed: float) -> dict[str, Any]:
        """Command all robots, with a pause between them, as many users would."""
        self._stamps.clear()
        self._send(seconds, speed)
        return {"stamps": list(self._stamps), **self._look(speed)}

    def _send(self, seconds: float, speed: float) -> None:
        message = Twist()
        message.linear.x = speed
        until, pause = time.monotonic() + seconds, _PERIOD / len(self._publishers)
        while time.monotonic() < until:
            for publisher in self._publishers:
                publisher.publish(message)
                time.sleep(pause)

    def _look(self, speed: float) -> dict[str, Any]:
        """Return the speeds and places of all; only now, as to receive all odometry takes time."""
        last: dict[str, Odometry] = {}
        subscriptions = [
            self._node.create_subscription(
                Odometry, f"{topic}/ground_truth", lambda m, name=name: last.update({name: m}), 1
            )
            for name, topic in self._topics.items()
        ]
        while len(last) < len(self._names):
            self._send(_PERIOD, speed)
        for subscription in subscriptions:
            self._node.destroy_subscription(subscription)
        places = {name: m.pose.pose.position for name, m in last.items()}
        return {
            "speeds": {name: m.twist.twist.linear.x for name, m in last.items()},
            "placed": {name: (place.x, place.y) for name, place in places.items()},
        }

    def _count(self, message: JointState) -> None:
        stamp = message.header.stamp
        self._stamps.append(stamp.sec + 1e-9 * stamp.nanosec)

    def _spin(self) -> None:
        try:
            rclpy.spin(self._node)
        except ExternalShutdownException:
            pass


def main(names: list[str]) -> None:
    """Command what is ordered until the input ends."""
    use_environment_prefix()
    configure_discovery()
    rclpy.init(args=[])
    commander = Commander(names)
    try:
        print("[]", flush=True)
        for line in sys.stdin:
            print(json.dumps(commander.command(**json.loads(line))), flush=True)
    except KeyboardInterrupt:
        pass
    rclpy.try_shutdown()


if __name__ == "__main__":
    main(sys.argv[1:])
