"""What the controller publishes, as ROS messages."""

from array import array

import numpy as np
from geometry_msgs.msg import (
    Point,
    PoseStamped,
    Quaternion,
    TransformStamped,
    TwistStamped,
    Vector3,
)
from nav_msgs.msg import Odometry
from numpy.typing import NDArray
from sensor_msgs.msg import JointState

from onebot_control.drive import Snapshot
from onebot_control.frames import PlanarPose, yaw_of
from onebot_control.joint_state_broadcaster import JointStateBroadcaster
from onebot_description.tf.messages import time_message

Floats = NDArray[np.float64]


def transform_row(pose: PlanarPose) -> Floats:
    """Return a planar pose as translation x y z, rotation x y z w: shape (1, 7)."""
    half = pose.yaw / 2.0
    return np.array([[pose.x, pose.y, 0.0, 0.0, 0.0, np.sin(half), np.cos(half)]])


def transform_message(stamp_ns: int, parent: str, child: str, pose: PlanarPose) -> TransformStamped:
    """Return a planar pose as a transform."""
    x, y, z, qx, qy, qz, qw = transform_row(pose)[0].tolist()
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id, message.header.stamp = parent, time_message(stamp_ns)
    message.transform.translation = Vector3(x=x, y=y, z=z)
    message.transform.rotation = Quaternion(x=qx, y=qy, z=qz, w=qw)
    return message


def planar_pose(message: PoseStamped) -> PlanarPose:
    """Return a pose as seen from above; NaN where its quaternion is none."""
    p, q = message.pose.position, message.pose.orientation
    norm = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w
    yaw = yaw_of(q.x, q.y, q.z, q.w) if 0.98 < norm < 1.02 else np.nan
    return PlanarPose(p.x, p.y, yaw)


class OdometryMessage:
    """A nav_msgs/Odometry that is filled again and again."""

    def __init__(
        self,
        frame: str,
        child: str,
        pose_variances: tuple[float, ...] = (0.0,) * 6,
        twist_variances: tuple[float, ...] = (0.0,) * 6,
    ) -> None:
        """Write what never changes; the variances are the covariances' diagonals."""
        self._message = Odometry(child_frame_id=child)
        self._message.header.frame_id = frame
        self._message.pose.covariance = np.diag(pose_variances).ravel()
        self._message.twist.covariance = np.diag(twist_variances).ravel()

    def fill(self, stamp_ns: int, pose: Floats, linear: Floats, angular: Floats) -> Odometry:
        """Return the message.

        Args:
            stamp_ns: nanoseconds.
            pose: (7,): translation x y z in m, rotation x y z w.
            linear: (3,), m/s, in the child's frame.
            angular: (3,), rad/s.
        """
        message = self._message
        x, y, z, qx, qy, qz, qw = pose.tolist()
        message.header.stamp = time_message(stamp_ns)
        message.pose.pose.position = Point(x=x, y=y, z=z)
        message.pose.pose.orientation = Quaternion(x=qx, y=qy, z=qz, w=qw)
        twist = message.twist.twist
        twist.linear.x, twist.linear.y, twist.linear.z = linear.tolist()
        twist.angular.x, twist.angular.y, twist.angular.z = angular.tolist()
        return message


def joint_state(
    broadcaster: JointStateBroadcaster, snapshot: Snapshot, stamp_ns: int
) -> JointState:
    """Return the joint states that ``broadcaster`` chooses."""
    states = broadcaster.arrays(snapshot.joints)
    message = JointState(name=broadcaster.names)
    message.header.stamp, message.header.frame_id = time_message(stamp_ns), broadcaster.frame_id
    message.position = array("d", states.positions.tobytes())
    message.velocity = array("d", states.velocities.tobytes())
    message.effort = array("d", states.efforts.tobytes())
    return message


def limited_command(snapshot: Snapshot, stamp_ns: int, frame: str) -> TwistStamped:
    """Return the command after the limiter."""
    message = TwistStamped()
    message.header.stamp, message.header.frame_id = time_message(stamp_ns), frame
    message.twist.linear.x = snapshot.command.linear
    message.twist.angular.z = snapshot.command.angular
    return message
