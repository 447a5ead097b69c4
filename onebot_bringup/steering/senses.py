"""What the robot that is steered senses: its camera's picture, and what its scan sees in its way.

A camera may cost the robot much, so its topic is subscribed to while a page shows the picture.
"""

import io
import math
import time
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Image as ImageMessage
from sensor_msgs.msg import LaserScan
from std_msgs.msg import String

from onebot_bringup.steering.followed_topics import FollowedTopics
from onebot_bringup.steering.odometry_topic import OdometryTopic
from onebot_description.description import parse_description
from onebot_description.errors import OneBotError
from onebot_description.model import quaternions
from onebot_description.model.robot_model import RobotModel
from onebot_description.topic_subscription import TopicSubscription

Floats = NDArray[np.float64]

_TYPES = {
    "sensor_msgs/msg/Image": ImageMessage,
    "sensor_msgs/msg/LaserScan": LaserScan,
    "std_msgs/msg/String": String,
}
_IMAGE, _SCAN, _STRING = _TYPES
# Pillow's modes, as the picture is to be and as it is, of the encodings of pictures for people.
_MODES = {
    "rgb8": ("RGB", "RGB"),
    "bgr8": ("RGB", "BGR"),
    "rgba8": ("RGB", "RGBX"),
    "bgra8": ("RGB", "BGRX"),
    "mono8": ("L", "L"),
}
_SIZE = (480, 360)  # pixels at most
_UNUSED = 3.0  # s without a request until the camera is left
_OLD = 1.0  # s after which a scan counts no more
_STANDING = 0.01  # m/s; slower is no direction


class Footprint(NamedTuple):
    """A robot as its description has it, in the frame of its root link; metres."""

    low: Floats  # (2,): x and y of a box around it
    high: Floats
    links: dict[str, Floats]  # poses (4, 4)

    @classmethod
    def of(cls, urdf: str) -> "Footprint | None":
        """Return the robot of a URDF; None if it is none, or has no shapes."""
        from onebot_control.sensing.solids import solid_of

        try:
            robot = parse_description(urdf, "robot_description")
            robot.require_tree()
        except OneBotError:
            return None
        poses = {}
        for name, pose in zip(robot.link_names, RobotModel(robot).link_poses({}), strict=True):
            poses[name] = np.eye(4)
            poses[name][:3, :3], poses[name][:3, 3] = quaternions.to_matrix(pose[3:]), pose[:3]
        shapes = [
            (shape, poses[link.name])
            for link in robot.links
            for shape in link.collisions or link.visuals
        ]
        corners = solid_of(shapes).corners[:, :2].astype(float)
        return cls(corners.min(axis=0), corners.max(axis=0), poses) if len(corners) else None

    def points(self, scan: LaserScan) -> Floats:
        """Return what a scan sees beside the robot, (N, 2) m; nothing if its frame is no link."""
        frame = scan.header.frame_id  # a prefix may be before the link's name
        link = max((name for name in self.links if frame.endswith(name)), key=len, default=None)
        if link is None:
            return np.empty((0, 2))
        ranges = np.asarray(scan.ranges, float)
        angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
        seen = (ranges >= scan.range_min) & (ranges <= scan.range_max)
        flat = ranges[seen] * (np.cos(angles[seen]), np.sin(angles[seen]))
        points = flat.T @ self.links[link][:2, :2].T + self.links[link][:2, 3]
        outside: Floats = points[~((points > self.low) & (points < self.high)).all(axis=1)]
        return outside

    def clearance(self, points: Floats, linear: float, angular: float) -> float:
        """Return how far the robot can go, in m, until it meets a point; infinite without one.

        Args:
            points: (N, 2), x and y in m.
            linear: m/s, not 0; the robot goes on along its arc.
            angular: rad/s.
        """
        ahead = math.copysign(1.0, linear)
        x, y = ahead * points[:, 0], points[:, 1]
        along, aside = x, y
        if abs(angular) > 1e-3 * abs(linear):
            radius = linear / angular  # positive: left
            side = math.copysign(1.0, radius)
            along = abs(radius) * np.arctan2(x, side * (radius - y))
            aside = np.hypot(x, y - radius) - abs(radius)
        front = self.high[0] if linear > 0.0 else -self.low[0]
        half = max(-self.low[1], self.high[1])
        met = along[(along > 0.0) & (np.abs(aside) < half)] - front
        return max(0.0, float(met.min(initial=math.inf)))


def jpeg(message: ImageMessage) -> bytes | None:
    """Return a picture as a small JPEG; None if it is none for people, such as depth."""
    if message.encoding not in _MODES:
        return None
    (mode, raw), size = _MODES[message.encoding], (message.width, message.height)
    try:
        picture = Image.frombytes(mode, size, bytes(message.data), "raw", raw, message.step, 1)
    except ValueError:
        return None  # less bytes than it says
    picture.thumbnail(_SIZE)
    file = io.BytesIO()
    picture.save(file, "JPEG")
    return file.getvalue()


class Senses:
    """Follows the topics of the robot that is steered; all but ``picture`` in the node's thread.

    Attributes:
        camera: the topic of its pictures, "" for none.
    """

    def __init__(self, node: Node, odometry: OdometryTopic) -> None:
        self._node, self._odometry = node, odometry
        self._topics = FollowedTopics(node, 1, self._subscription)
        self._used = -math.inf  # when a picture was requested
        self._picture: bytes | None = None  # the newest message
        self._drawn: tuple[bytes | None, bytes | None] = None, None  # a message and its JPEG
        self._footprint: Footprint | None = None
        self._seen = math.inf, -math.inf  # the clearance, and when it was
        self.camera = ""

    @property
    def obstacle(self) -> float | None:
        """How far the robot can go until it meets what its scan sees, m; None: nothing known."""
        clearance, when = self._seen
        return clearance if clearance < math.inf and time.monotonic() < when + _OLD else None

    def update(self, namespace: str, robots: Iterable[str], watched: bool) -> None:
        """Follow publishers that come and go; to be called several times per second.

        ``robots`` are the namespaces of other robots; ``watched``: there is a page.
        """
        spaces = tuple(f"{space}/" for space in robots if space.startswith(f"{namespace}/"))
        names: dict[str, list[str]] = {kind: [] for kind in _TYPES}
        for name, kinds in self._node.get_topic_names_and_types():
            is_own = name.startswith(f"{namespace}/") and not name.startswith(spaces)
            if is_own and kinds[0] in names and self._node.count_publishers(name):
                names[kinds[0]].append(name)

        def first(kind: str) -> str:
            rank = [("depth" in name, name.count("/"), name) for name in names[kind]]
            return min(rank)[-1] if rank else ""

        self.camera = first(_IMAGE)
        topics = {}
        if watched:
            topics = {first(_SCAN): _SCAN, f"{namespace}/robot_description": _STRING}
        if time.monotonic() < self._used + _UNUSED:
            topics[self.camera] = _IMAGE
        topics.pop("", None)
        left = self._topics.update(topics)
        if _STRING in left:
            self._footprint = None
        if _IMAGE in left:
            self._picture = None
        if _SCAN in left:
            self._seen = math.inf, -math.inf

    def _subscription(self, name: str, kind: str) -> TopicSubscription:
        received = {_IMAGE: self._on_picture, _SCAN: self._on_scan, _STRING: self._on_robot}[kind]
        return TopicSubscription(self._node, name, received, _TYPES.__getitem__, raw=kind == _IMAGE)

    def _on_picture(self, _: str, data: bytes) -> None:
        self._picture = data

    def _on_robot(self, _: str, message: String) -> None:
        self._footprint = Footprint.of(message.data)

    def _on_scan(self, _: str, scan: LaserScan) -> None:
        odometry, footprint, clearance = self._odometry.sample, self._footprint, math.inf
        if footprint is not None and odometry is not None and abs(odometry.linear[0]) > _STANDING:
            linear, angular = float(odometry.linear[0]), float(odometry.angular[2])
            clearance = footprint.clearance(footprint.points(scan), linear, angular)
        self._seen = clearance, time.monotonic()

    def picture(self) -> bytes | None:
        """Return the newest picture as JPEG, in any thread; the camera is followed for a while."""
        self._used = time.monotonic()
        data, drawn = self._picture, self._drawn
        if data is not None and data is not drawn[0]:
            self._drawn = drawn = data, jpeg(deserialize_message(data, ImageMessage))
        return drawn[1] if data is not None else None
