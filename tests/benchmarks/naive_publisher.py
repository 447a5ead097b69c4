"""A robot_state_publisher as one writes it in rclpy: message objects, one joint after the other.

``python -m tests.benchmarks.naive_publisher FILE``; FILE is a URDF.
"""

import math
import sys
from typing import Any

import yourdfpy
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from rclpy.node import Node
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState

from onebot_description.node import run_node
from onebot_description.wire.tf_message import TFMessage


class NaivePublisher(Node):
    """Publishes a TransformStamped for each joint of each JointState."""

    def __init__(self, file: str) -> None:
        super().__init__("naive_publisher")
        robot = yourdfpy.URDF.load(file, build_scene_graph=False, load_meshes=False).robot
        self._joints = {joint.name: (joint, *_origin(joint)) for joint in robot.joints}
        self._tf = self.create_publisher(TFMessage, "/tf", QoSProfile(depth=100))
        self.create_subscription(
            JointState, "joint_states", self._on_joint_state, qos_profile_sensor_data
        )

    def _on_joint_state(self, state: Any) -> None:
        transforms = []
        for name, position in zip(state.name, state.position, strict=True):
            joint, translation, rotation = self._joints[name]
            message = TransformStamped()
            message.header.stamp = state.header.stamp
            message.header.frame_id = joint.parent
            message.child_frame_id = joint.child
            message.transform.translation = translation
            message.transform.rotation = _turned(rotation, joint.axis, position)
            transforms.append(message)
        self._tf.publish(TFMessage(transforms=transforms))


def _origin(joint: Any) -> tuple[Any, tuple[float, ...]]:
    x, y, z = joint.origin[:3, 3].tolist()
    return Vector3(x=x, y=y, z=z), tuple(Rotation.from_matrix(joint.origin[:3, :3]).as_quat())


def _turned(rotation: tuple[float, ...], axis: Any, angle: float) -> Any:
    """Return the quaternion of ``rotation`` followed by a turn about ``axis``."""
    length = math.hypot(*axis)
    sine = math.sin(angle / 2.0) / length
    bx, by, bz, bw = axis[0] * sine, axis[1] * sine, axis[2] * sine, math.cos(angle / 2.0)
    ax, ay, az, aw = rotation
    return Quaternion(
        x=float(aw * bx + ax * bw + ay * bz - az * by),
        y=float(aw * by - ax * bz + ay * bw + az * bx),
        z=float(aw * bz + ax * by - ay * bx + az * bw),
        w=float(aw * bw - ax * bx - ay * by - az * bz),
    )


if __name__ == "__main__":
    _, urdf = sys.argv
    sys.exit(run_node(lambda: NaivePublisher(urdf), []))
