"""Planar poses as ROS messages, and back."""

import math

from geometry_msgs.msg import PoseStamped, Quaternion, TransformStamped, Vector3

from onebot_control.frames import PlanarPose, yaw_of
from onebot_description.tf.messages import time_message


def transform_values(pose: PlanarPose) -> tuple[float, ...]:
    """Return a planar pose as translation x y z, rotation x y z w."""
    half = pose.yaw / 2.0
    return (pose.x, pose.y, 0.0, 0.0, 0.0, math.sin(half), math.cos(half))


def transform_message(stamp_ns: int, parent: str, child: str, pose: PlanarPose) -> TransformStamped:
    """Return a planar pose as a transform."""
    x, y, z, qx, qy, qz, qw = transform_values(pose)
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id, message.header.stamp = parent, time_message(stamp_ns)
    message.transform.translation = Vector3(x=x, y=y, z=z)
    message.transform.rotation = Quaternion(x=qx, y=qy, z=qz, w=qw)
    return message


def planar_pose(message: PoseStamped) -> PlanarPose:
    """Return a pose as seen from above; NaN where its quaternion is none."""
    p, q = message.pose.position, message.pose.orientation
    norm = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w
    yaw = yaw_of(q.x, q.y, q.z, q.w) if 0.98 < norm < 1.02 else math.nan
    return PlanarPose(p.x, p.y, yaw)
