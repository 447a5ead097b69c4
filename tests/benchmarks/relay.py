"""The floor under any rclpy node that answers: receives JointState raw, sends constant bytes.

``python -m tests.benchmarks.relay FILE``; FILE holds the serialized TFMessage.
"""

import sys
from pathlib import Path

from rclpy.node import Node
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState

from onebot_description.ros.run_node import run_node
from onebot_description.ros.wire.interfaces import TFMessage


class Relay(Node):
    """Publishes the same bytes for each message, with robot_state_publisher's QoS."""

    def __init__(self, answer: bytes) -> None:
        super().__init__("relay")
        self._answer = answer
        self._tf = self.create_publisher(TFMessage, "/tf", QoSProfile(depth=100))
        self.create_subscription(
            JointState, "joint_states", self._relay, qos_profile_sensor_data, raw=True
        )

    def _relay(self, _data: bytes) -> None:
        self._tf.publish(self._answer)


if __name__ == "__main__":
    content = Path(sys.argv[1]).read_bytes()
    sys.exit(run_node(lambda: Relay(content), []))
