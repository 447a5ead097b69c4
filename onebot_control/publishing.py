"""The topics that velocity_controller publishes in each control cycle."""

import math

import numpy as np
from geometry_msgs.msg import PoseStamped, Quaternion, TransformStamped, TwistStamped, Vector3
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from onebot_control.control_loop import Divider
from onebot_control.drive import Drive, Snapshot
from onebot_control.poses import PlanarPose, prefixed, yaw_of
from onebot_control.wire import (
    JointStateTemplate,
    OdometryTemplate,
    TransformTemplate,
    TwistTemplate,
    clock,
    pack_stamp,
)
from onebot_description.model import quaternions
from onebot_description.node import LATCHED
from onebot_description.wire.messages import time_message
from onebot_description.wire.tf_message import TFMessage

# Planar poses as ROS messages, and back.


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


_DEPTH = 10  # ROS's system default


class Publishers:
    """Turns a robot's snapshots into messages. Used by the control thread only."""

    def __init__(self, node: Node, simulated: bool) -> None:
        """Announce the topics; with /clock if ``simulated``."""
        self._namespace: str = node.get_namespace()
        self._joint_states = node.create_publisher(JointState, "joint_states", _DEPTH)
        self._odom = node.create_publisher(Odometry, "~/odom", _DEPTH)
        self._truth = node.create_publisher(Odometry, "~/ground_truth", _DEPTH)
        self._tf = node.create_publisher(TFMessage, "/tf", _DEPTH)
        self._tf_static = node.create_publisher(TFMessage, "/tf_static", LATCHED)
        self._limited = node.create_publisher(TwistStamped, "~/cmd_vel_out", _DEPTH)
        self._clock = node.create_publisher(Clock, "/clock", _DEPTH) if simulated else None
        self._origin: PlanarPose | None = None

    def use(self, drive: Drive) -> None:
        """Serve this robot, with its parameters as they are now."""
        self._drive = drive
        config = drive.config
        odom, self._base = (
            prefixed(frame, config.tf_frame_prefix_enable, config.tf_frame_prefix, self._namespace)
            for frame in (config.odom_frame_id, config.base_frame_id)
        )
        self.odom_frame, self._world = odom, config.world_frame_id
        variances = config.pose_covariance_diagonal, config.twist_covariance_diagonal
        self._odom_message = OdometryTemplate(odom, self._base, *variances)
        self._truth_message = OdometryTemplate(self._world or odom, self._base)
        self._transform = TransformTemplate(odom, self._base)
        self._limited_message = TwistTemplate(self._base)
        broadcaster = drive.broadcaster
        self._joint_message = JointStateTemplate(broadcaster.frame_id, broadcaster.names)
        self._due = Divider(config.publish_rate, config.update_rate)
        self._origin = None

    def publish(self, snapshot: Snapshot, stamp_ns: int) -> None:
        """Publish all that is due."""
        drive, stamp = self._drive, pack_stamp(stamp_ns)
        if self._clock is not None:
            self._clock.publish(clock(stamp))
        joints = drive.broadcaster.values(snapshot.joints)
        self._joint_states.publish(self._joint_message.fill(stamp, *joints))
        if drive.config.publish_limited_velocity:
            command = _planar(snapshot.command.linear, snapshot.command.angular)
            self._limited.publish(self._limited_message.fill(stamp, command))
        if self._due.due():
            self._publish_odometry(snapshot, stamp)
        if drive.origin != self._origin:
            self._publish_origin(stamp_ns)

    def _publish_odometry(self, snapshot: Snapshot, stamp: bytes) -> None:
        pose = transform_values(snapshot.odometry)
        if self._drive.config.enable_odom_tf:
            self._tf.publish(self._transform.fill(stamp, pose))
        self._odom.publish(self._odom_message.fill(stamp, pose, _planar(*snapshot.twist)))
        linear, angular = snapshot.velocity
        velocity = (*linear.tolist(), *angular.tolist())
        self._truth.publish(self._truth_message.fill(stamp, self._true_pose(snapshot), velocity))

    def _true_pose(self, snapshot: Snapshot) -> tuple[float, ...]:
        translation, rotation = snapshot.pose
        if not self._world:
            back = np.array(transform_values(self._drive.origin.inverse()))
            translation = back[:3] + quaternions.rotate(back[3:], translation)
            rotation = quaternions.multiply(back[3:], rotation)
        return (*translation.tolist(), *rotation.tolist())

    def _publish_origin(self, stamp_ns: int) -> None:
        """Say where the odometry's zero lies in the world."""
        self._origin = self._drive.origin
        if self._world:
            frames = self._world, self.odom_frame
            transform = transform_message(stamp_ns, *frames, self._origin)
            self._tf_static.publish(TFMessage(transforms=[transform]))


def _planar(linear: float, angular: float) -> tuple[float, ...]:
    """Return a twist forward and to the left: linear x y z, angular x y z."""
    return (linear, 0.0, 0.0, 0.0, 0.0, angular)
