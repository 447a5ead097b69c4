"""The inputs of the navigator: scans, odometry, the IMU, TF, and commands of other nodes."""

import math
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import Imu, LaserScan
from std_msgs.msg import Bool

from onebot_control.conventions import DRIVE_CONTROLLER
from onebot_control.navigation.grid import LevelScan, is_level
from onebot_control.nodes.robot_services import planar_pose
from onebot_control.nodes.velocity_messages import VELOCITY_TYPES, twist_of, velocity_message
from onebot_description.arrays import Floats
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import PlanarPose, Triple
from onebot_description.ros.frame_tree import FrameTree
from onebot_description.ros.tf_subscription import subscribe_to_tf
from onebot_description.ros.topic_qos import ANY_PUBLISHER, DEPTH, LATCHED, make_qos
from onebot_description.ros.transform_buffer import TransformException
from onebot_description.ros.wire.cdr import nanoseconds
from onebot_description.ros.wire.message_arrays import TfArrays
from onebot_description.timing import NS_PER_S
from onebot_description.timing.throttled import Throttled

COMMAND_TOPIC = f"{DRIVE_CONTROLLER}/cmd_vel"
_ODOMETRY_TOPIC = f"{DRIVE_CONTROLLER}/odom"
_LEAST_STEP = 1e-5  # rad between two rays
_SCANS = 10  # maximum number of scans that wait for the odometry
_KEPT = 50  # number of remembered own commands that have not come back yet


class TimedOdometry(NamedTuple):
    """The robot's odometry with its stamp."""

    stamp_ns: int
    odom_frame: str
    base_frame: str
    pose: PlanarPose
    speed: Triple  # forward, to the left, m/s; to the left, rad/s

    @property
    def time(self) -> float:
        """Its stamp, s."""
        return self.stamp_ns / NS_PER_S


class Measurements:
    """The latest measurements.

    Attributes:
        motion: the latest odometry; None until there is one.
        locked: whether the robot is locked, so that it ignores commands.
    """

    def __init__(self, node: Node, overruled: Callable[[str], None]) -> None:
        """Subscribe; ``overruled`` is called with a reason when the robot is locked."""
        self._overruled = overruled
        self._tree = FrameTree()
        self.motion: TimedOdometry | None = None
        self.locked = False
        self._scans = deque[LevelScan](maxlen=_SCANS)
        self._turned: float | None = None
        self._last_turn = 0, 0.0  # stamp and rate of the latest IMU message
        self._warn = Throttled(lambda text: node.get_logger().warning(text))
        latest = make_qos(1, reliable=False, latched=False)
        node.create_subscription(LaserScan, "scan", self._on_scan, latest)
        node.create_subscription(Odometry, _ODOMETRY_TOPIC, self._on_odometry, ANY_PUBLISHER)
        node.create_subscription(Imu, "imu", self._on_imu, ANY_PUBLISHER)
        command = node.resolve_topic_name(COMMAND_TOPIC)
        node.create_subscription(Bool, f"{command}_locked", self._on_lock, LATCHED)
        subscribe_to_tf(node, self._on_tf)

    def _on_tf(self, message: TfArrays, static: bool) -> None:
        self._tree.add(message, static=static)

    def pose(self, target: str, source: str) -> Floats:
        """Return the latest pose (4, 4) of frame ``source`` in frame ``target``.

        Raises:
            OneBotError: there is none.
        """
        try:
            return self._tree.lookup(target, source).matrix
        except TransformException as error:
            raise OneBotError(str(error)) from None

    def take_scan(self) -> LevelScan | None:
        """Return the latest scan not later than the odometry, if it is new."""
        scan = None
        while self._scans and self.motion and (self._scans[0].time or 0.0) <= self.motion.time:
            scan = self._scans.popleft()
        return scan

    def take_turn(self) -> float | None:
        """Return the turn measured by the IMU since the last call, rad; None without an IMU."""
        turned, self._turned = self._turned, None if self._turned is None else 0.0
        return turned

    def _on_scan(self, message: LaserScan) -> None:
        if self.motion is None:
            return
        try:
            mount = self.pose(self.motion.base_frame, message.header.frame_id)
            if not is_level(mount):
                raise OneBotError("the lidar is not level")
            self._scans.append(scan_of(message, mount))
        except OneBotError as error:
            self._warn("scan", f"scans are ignored: {error}")

    def _on_odometry(self, message: Odometry) -> None:
        pose, twist = planar_pose(message.pose), message.twist.twist
        speed = twist.linear.x, twist.linear.y, twist.angular.z
        if not all(map(math.isfinite, (*pose, *speed))):
            self._warn("odometry", "odometry is ignored: it is not finite, or not normalized")
            return
        stamp, header = nanoseconds(message.header.stamp), message.header
        if self.motion is not None and stamp < self.motion.stamp_ns:
            self._scans.clear()
        self.motion = TimedOdometry(stamp, header.frame_id, message.child_frame_id, pose, speed)

    def _on_imu(self, message: Imu) -> None:
        rates, stamp = message.angular_velocity, nanoseconds(message.header.stamp)
        with suppress(OneBotError):  # its frame is not in TF yet
            if self.motion is not None:
                axes = self.pose(self.motion.base_frame, message.header.frame_id)
                rate, (before, last) = axes[2, :3] @ (rates.x, rates.y, rates.z), self._last_turn
                if math.isfinite(rate):
                    self._last_turn = stamp, float(rate)
                    if 0 < (elapsed := stamp - before) < NS_PER_S:
                        turn = (last + float(rate)) / 2.0 * elapsed / NS_PER_S
                        self._turned = (self._turned or 0.0) + turn

    def _on_lock(self, message: Bool) -> None:
        self.locked = message.data
        if self.locked:
            self._overruled("the robot was locked")


def scan_of(message: LaserScan, mount: Floats) -> LevelScan:
    """Convert a LaserScan of a lidar whose pose in the robot's frame is ``mount`` (4, 4).

    Raises:
        OneBotError: its angles are not valid, or it measures nothing.
    """
    ranges = np.asarray(message.ranges, np.float32)
    first_angle, step = float(message.angle_min), float(message.angle_increment)
    if not _LEAST_STEP < abs(step) < math.tau or not math.isfinite(first_angle):
        raise OneBotError("the angles of a scan are not valid")
    with np.errstate(invalid="ignore"):
        ranges = np.where(ranges < message.range_min, -np.inf, ranges)
        ranges = np.where(ranges > message.range_max, np.inf, ranges).astype(np.float32)
    if not (ranges > -np.inf).any():
        raise OneBotError("a scan has no ranges, or all are NaN or below range_min")
    scan = LevelScan.mounted(ranges, first_angle, step, float(message.range_max), mount)
    return scan._replace(time=nanoseconds(message.header.stamp) / NS_PER_S)


class Commands:
    """Commands the robot, and detects commands of other nodes.

    The message type is that of the robot's subscription; Twist, if there are both.
    """

    def __init__(self, node: Node, overruled: Callable[[str], None]) -> None:
        """Prepare; ``overruled`` is called with a reason when another node commands the robot."""
        self._node, self._overruled = node, overruled
        self._topic = node.resolve_topic_name(COMMAND_TOPIC)
        self._kind: str | None = None
        self._sent = deque[tuple[float, ...]](maxlen=_KEPT)

    def subscribers(self) -> list[Any]:
        """Return the subscriptions to commands."""
        return list(self._node.get_subscriptions_info_by_topic(self._topic))

    def prepare(self) -> None:
        """Connect to the robot, if it is present.

        Raises:
            OneBotError: no robot subscribes to commands.
        """
        if self._kind is not None:
            return
        types = {end.topic_type for end in self.subscribers()}
        known_kinds = [kind for kind in VELOCITY_TYPES if kind in types]
        if not known_kinds:
            raise OneBotError(f"no robot subscribes to {self._topic}")
        self._kind = known_kinds[0]
        message_class = VELOCITY_TYPES[self._kind]
        self._publisher = self._node.create_publisher(message_class, self._topic, DEPTH)
        self._node.create_subscription(message_class, self._topic, self._on_command, DEPTH)

    def publish(self, command: Triple) -> None:
        """Publish a velocity forward and to the left, m/s, and turning to the left, rad/s."""
        if self._kind is None:
            return
        message = velocity_message(self._node, self._kind, *command)
        self._sent.append(_values(message))
        self._publisher.publish(message)

    def _on_command(self, message: Any) -> None:
        values = _values(message)
        if values not in self._sent:
            self._overruled("another node drives the robot")
            return
        while self._sent.popleft() != values:  # the ones before it were lost
            pass


def _values(message: Any) -> tuple[float, ...]:
    twist = twist_of(message)
    return twist.linear.x, twist.linear.y, twist.angular.z
