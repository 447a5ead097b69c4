"""The inputs of the navigator: scans, odometry, the IMU, TF, and commands of other nodes."""

import math
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.node import Node
from sensor_msgs.msg import Imu, LaserScan
from std_msgs.msg import Bool

from onebot_control.conventions import DRIVE_CONTROLLER
from onebot_control.navigation.grid import LevelScan, is_level
from onebot_control.nodes.velocity_messages import VELOCITY_TYPES, twist_of, velocity_message
from onebot_description.arrays import Floats
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import PlanarPose, Triple, yaw_of
from onebot_description.ros.frame_tree import FrameTree
from onebot_description.ros.topic_qos import ANY_PUBLISHER, DEPTH, LATCHED, make_qos
from onebot_description.ros.transform_buffer import TransformException
from onebot_description.ros.wire.cdr import nanoseconds
from onebot_description.ros.wire.interfaces import TFMessage
from onebot_description.ros.wire.message_arrays import BAD_MESSAGE, tf_arrays
from onebot_description.timing import NS_PER_S
from onebot_description.timing.throttled import Throttled

COMMAND_TOPIC = f"{DRIVE_CONTROLLER}/cmd_vel"
_ODOMETRY_TOPIC = f"{DRIVE_CONTROLLER}/odom"
_TF_DEPTH = 100
_SCANS = 10  # maximum number of scans that wait for the odometry
_KEPT = 50  # number of remembered own commands


class TimedScan(NamedTuple):
    """A scan with its stamp."""

    stamp_ns: int
    scan: LevelScan


class TimedOdometry(NamedTuple):
    """The robot's odometry with its stamp."""

    stamp_ns: int
    odom_frame: str
    base_frame: str
    pose: PlanarPose
    speed: Triple  # forward, to the left, m/s; to the left, rad/s


class Transforms:
    """The TF tree from /tf and /tf_static."""

    def __init__(self, node: Node) -> None:
        """Subscribe."""
        self.tree = FrameTree()
        for topic, latched in (("/tf", False), ("/tf_static", True)):
            node.create_subscription(
                TFMessage,
                topic,
                lambda data, static=latched: self._on_tf(data, static),
                make_qos(_TF_DEPTH, reliable=True, latched=latched),
                raw=True,
            )

    def _on_tf(self, data: bytes, static: bool) -> None:
        try:
            message = tf_arrays(data)
        except BAD_MESSAGE:
            return
        if message.children:
            self.tree.add(message, static=static)

    def pose(self, target: str, source: str) -> Floats:
        """Return the latest pose (4, 4) of frame ``source`` in frame ``target``.

        Raises:
            OneBotError: there is none.
        """
        if target == source:
            return np.eye(4)
        try:
            return self.tree.lookup(target, source).matrix
        except TransformException as error:
            raise OneBotError(str(error)) from None


class Measurements:
    """The latest measurements.

    Attributes:
        motion: the latest odometry; None until there is one.
        transforms: the TF tree.
        locked: whether the robot is locked, so that it ignores commands.
    """

    def __init__(self, node: Node, overruled: Callable[[str], None]) -> None:
        """Subscribe; ``overruled`` is called with a reason when the robot is locked."""
        self._overruled = overruled
        self.transforms = Transforms(node)
        self.motion: TimedOdometry | None = None
        self.locked = False
        self._scans = deque[TimedScan](maxlen=_SCANS)
        self._turned: float | None = None
        self._last_turn: tuple[int, float] | None = None  # stamp and rate of the latest IMU message
        self._warn = Throttled(lambda text: node.get_logger().warning(text))
        node.create_subscription(
            LaserScan, "scan", self._on_scan, make_qos(1, reliable=False, latched=False)
        )
        node.create_subscription(Odometry, _ODOMETRY_TOPIC, self._on_odometry, ANY_PUBLISHER)
        node.create_subscription(Imu, "imu", self._on_imu, ANY_PUBLISHER)
        command = node.resolve_topic_name(COMMAND_TOPIC)
        node.create_subscription(Bool, f"{command}_locked", self._on_lock, LATCHED)

    def take_scan(self) -> TimedScan | None:
        """Return the latest scan not later than the odometry, if it is new."""
        scan = None
        while self._scans and self.motion and self._scans[0].stamp_ns <= self.motion.stamp_ns:
            scan = self._scans.popleft()
        return scan

    def take_turn(self) -> float | None:
        """Return the turn measured by the IMU since the last call, rad; None without an IMU."""
        turned = self._turned
        if turned is not None:
            self._turned = 0.0
        return turned

    def _on_scan(self, message: LaserScan) -> None:
        motion = self.motion
        if motion is None or message.angle_increment == 0.0 or not len(message.ranges):
            return
        try:
            mount = self.transforms.pose(motion.base_frame, message.header.frame_id)
        except OneBotError as error:
            self._warn("frame", f"scans are ignored: {error}")
            return
        if not is_level(mount):
            self._warn("level", "scans are ignored: the lidar is not level")
            return
        scan = scan_of(message, mount)
        if np.isnan(scan.ranges).all():
            self._warn("nan", "a scan is ignored: all ranges are NaN")
            return
        self._scans.append(TimedScan(nanoseconds(message.header.stamp), scan))

    def _on_odometry(self, message: Odometry) -> None:
        at, turn, twist = message.pose.pose.position, message.pose.pose.orientation, message.twist
        pose = PlanarPose(at.x, at.y, yaw_of(turn.x, turn.y, turn.z, turn.w))
        linear, angular = twist.twist.linear, twist.twist.angular
        speed = linear.x, linear.y, angular.z
        if not all(map(math.isfinite, (*pose, *speed))):
            self._warn("odometry", "odometry is ignored: it is not finite")
            return
        stamp, header = nanoseconds(message.header.stamp), message.header
        if self.motion is not None and stamp < self.motion.stamp_ns:
            self._scans.clear()
        self.motion = TimedOdometry(stamp, header.frame_id, message.child_frame_id, pose, speed)

    def _on_imu(self, message: Imu) -> None:
        motion, stamp = self.motion, nanoseconds(message.header.stamp)
        if motion is None:
            return
        try:
            axes = self.transforms.pose(motion.base_frame, message.header.frame_id)
        except OneBotError:
            return
        rates = message.angular_velocity
        rate = float(axes[2, :3] @ (rates.x, rates.y, rates.z))
        last, self._last_turn = self._last_turn, (stamp, rate)
        if not math.isfinite(rate) or last is None or not 0 < stamp - last[0] < NS_PER_S:
            return
        turn = (last[1] + rate) / 2.0 * (stamp - last[0]) / NS_PER_S
        self._turned = (self._turned or 0.0) + turn

    def _on_lock(self, message: Bool) -> None:
        self.locked = message.data
        if self.locked:
            self._overruled("the robot was locked")


def scan_of(message: LaserScan, mount: Floats) -> LevelScan:
    """Convert a LaserScan of a lidar whose pose in the robot's frame is ``mount`` (4, 4)."""
    ranges = np.asarray(message.ranges, np.float32)
    with np.errstate(invalid="ignore"):
        ranges = np.where(ranges < message.range_min, -np.inf, ranges)
        ranges = np.where(ranges > message.range_max, np.inf, ranges).astype(np.float32)
    first_angle, step = float(message.angle_min), float(message.angle_increment)
    return LevelScan.mounted(ranges, first_angle, step, float(message.range_max), mount)


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
        if _values(message) not in self._sent:
            self._overruled("another node drives the robot")


def _values(message: Any) -> tuple[float, ...]:
    twist = twist_of(message)
    return twist.linear.x, twist.linear.y, twist.angular.z
