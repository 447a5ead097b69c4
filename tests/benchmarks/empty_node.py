"""The least that start-up can be: an rclpy node that loads PyBullet and publishes an Odometry.

``python -m tests.benchmarks.empty_node TOPIC``. It is the floor of the benchmark of start-up. As
our nodes do, it announces itself often: without that, every other start would wait for 3 s.
"""

import sys

import pybullet
import rclpy
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException

from onebot_description.elements.packages import use_environment_prefix
from onebot_description.ros.discovery import configure_discovery

_PERIOD = 0.01  # s, as the controller's


def main(topic: str) -> None:
    """Publish until Ctrl-C."""
    use_environment_prefix()
    configure_discovery()
    pybullet.connect(pybullet.DIRECT)
    rclpy.init(args=[])
    node = rclpy.create_node("empty")
    publisher = node.create_publisher(Odometry, topic, 10)
    message = Odometry(child_frame_id="base_link")
    message.header.frame_id = "odom"
    node.create_timer(_PERIOD, lambda: publisher.publish(message))
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    rclpy.try_shutdown()


if __name__ == "__main__":
    main(sys.argv[1])
