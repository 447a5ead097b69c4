"""Sends velocity commands at odd moments; a process of its own.

``python -m tests.benchmarks.commander TOPIC``. A line of JSON on standard input,
``{"seconds": ..., "hold": ...}``, makes it send Twists of ever other speeds for so long, and then
the speed ``hold`` (m/s); it is answered by one of all: ``[[command, monotonic time], ...]``. The
first line it prints, ``[]``, means that it has found a subscriber. It ends with its input.
"""

import json
import random
import sys
import time

import rclpy
from geometry_msgs.msg import Twist
from rclpy.publisher import Publisher

from onebot_description.description.packages import use_environment_prefix
from onebot_description.discovery import configure_discovery

PAUSES = (0.04, 0.06)  # s; a command is no older than cmd_vel_timeout, and meets all phases
_LEAST, _STEP = 0.1, 0.0001  # m/s
_HELD = 1.5  # s, for the acceleration's limit


def send(publisher: Publisher, speed: float) -> tuple[float, float]:
    """Publish a Twist; return its speed and when it was sent."""
    message = Twist()
    message.linear.x = speed
    now = time.monotonic()
    publisher.publish(message)
    return speed, now


def command(publisher: Publisher, seconds: float, hold: float) -> list[tuple[float, float]]:
    """Send commands, each with a speed of its own, and hold the last."""
    sent: list[tuple[float, float]] = []
    dice = random.Random(0)
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        sent.append(send(publisher, _LEAST + _STEP * (len(sent) % 500)))
        time.sleep(dice.uniform(*PAUSES))
    until = time.monotonic() + _HELD
    while time.monotonic() < until:
        send(publisher, hold)
        time.sleep(PAUSES[0])
    return sent


def main(topic: str) -> None:
    """Send what is ordered until the input ends."""
    use_environment_prefix()
    configure_discovery()
    rclpy.init(args=[])
    node = rclpy.create_node("commander")
    publisher = node.create_publisher(Twist, topic, 10)
    try:
        while not publisher.get_subscription_count():
            time.sleep(0.02)
        print("[]", flush=True)
        for line in sys.stdin:
            print(json.dumps(command(publisher, **json.loads(line))), flush=True)
    except KeyboardInterrupt:
        pass
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main(sys.argv[1])
