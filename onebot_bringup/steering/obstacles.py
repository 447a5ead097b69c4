"""Computes how far the steered robot can go until it meets an obstacle that its sensors see.

Every LaserScan and Range whose frame is on /tf is used, in the direction of travel. The ground is
not an obstacle: a cliff sensor sees it all the time, a tilted scanner at a distance.
"""

import math
import threading
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from sensor_msgs.msg import LaserScan, Range
from std_msgs.msg import String

from onebot_bringup.steering.followed_topics import FollowedTopics, RobotNamespace
from onebot_bringup.steering.odometry_topic import OdometryTopic
from onebot_bringup.steering.protocol import Velocity
from onebot_description.arrays import Floats
from onebot_description.description import Description, parse_description
from onebot_description.errors import OneBotError
from onebot_description.geometry.matrices import transformed

_SENSORS = frozenset({"sensor_msgs/msg/LaserScan", "sensor_msgs/msg/Range"})
_STRING = "std_msgs/msg/String"
_CONE_RAYS = 9  # number of rays across the cone of a Range
_OLD = 1.0  # s after which a scan is ignored
_STANDING = 0.01  # m/s; below this speed there is no direction
_ROUGHNESS, _TILT = 0.03, 0.03  # m, rad: tolerance, as ground and robot are not quite level
_HEADROOM = 0.1  # m


class Readings(NamedTuple):
    """A sensor's measurements along the rays that hit something."""

    directions: Floats  # (N, 3), of length 1 in the sensor's frame
    ranges: Floats  # (N,), m

    @classmethod
    def from_scan(cls, scan: LaserScan) -> "Readings":
        """Return the readings of a scan."""
        ranges = np.asarray(scan.ranges, float)
        angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
        met = (ranges >= scan.range_min) & (ranges <= scan.range_max) & np.isfinite(ranges + angles)
        return cls._level(angles[met], ranges[met])

    @classmethod
    def from_range(cls, message: Range) -> "Readings":
        """Return readings on rays across the cone, since the object may be on any of them.

        A detector of one fixed distance reports -inf for an object within it (REP-117).
        """
        met = message.range if message.range != -math.inf else message.max_range
        if not message.min_range <= met <= message.max_range:
            return cls._level(np.empty(0), np.empty(0))
        half = message.field_of_view / 2.0
        return cls._level(np.linspace(-half, half, _CONE_RAYS), np.full(_CONE_RAYS, met))

    def points(self, sensor: Floats) -> Floats:
        """Return the points (N, 3), m, that a sensor at a pose (4, 4) has hit."""
        return transformed(self.ranges[:, None] * self.directions, sensor)

    @classmethod
    def _level(cls, angles: Floats, ranges: Floats) -> "Readings":
        return cls(np.stack((np.cos(angles), np.sin(angles), 0.0 * angles), axis=1), ranges)


class Footprint(NamedTuple):
    """The box around a robot with its joints as described, in the root link's frame."""

    low: Floats  # (3,): lower corner of the box, m
    high: Floats

    @classmethod
    def from_description(cls, robot: Description) -> "Footprint | None":
        """Return the footprint of a robot; None if it has no shapes."""
        from onebot_control.sensing.solids import robot_solid

        solid = robot_solid(robot)
        if not len(solid.corners):
            return None
        low, high = solid.box
        return cls(low, high)

    def obstacles(self, readings: Readings, sensor: Floats) -> Floats:
        """Return the obstacles, x and y (N, 2) in m, that a sensor at a pose (4, 4) sees.

        Things above the robot, and the ground, do not count.
        """
        points = readings.points(sensor)
        directions = readings.directions @ sensor[:3, :3].T
        own_points = ((points > self.low) & (points < self.high)).all(axis=1)
        floor = self.low[2] + _ROUGHNESS + _TILT * readings.ranges
        ground = (directions[:, 2] < -_TILT) & (points[:, 2] < floor)
        above = points[:, 2] > max(self.high[2], sensor[2, 3]) + _HEADROOM
        seen: Floats = points[~(own_points | ground | above), :2]
        return seen

    def clearance(self, points: Floats, velocity: Velocity) -> float:
        """Return how far the robot can go along its arc until it meets a point, m; or infinity.

        Args:
            points: (N, 2), x and y in m.
            velocity: the robot's velocity, not a turn on the spot.
        """
        speed = velocity.speed
        ahead = np.array((velocity.linear, velocity.lateral)) / speed
        left = np.array((-ahead[1], ahead[0]))
        x, y = points @ ahead, points @ left
        along, aside = x, y
        if abs(velocity.angular) > 1e-3 * speed:
            radius = speed / velocity.angular  # positive: left
            side = math.copysign(1.0, radius)
            along = abs(radius) * np.arctan2(x, side * (radius - y))
            aside = np.hypot(x, y - radius) - abs(radius)
        box = [(x, y) for x in (self.low[0], self.high[0]) for y in (self.low[1], self.high[1])]
        front, half = np.max(box @ ahead), np.max(np.abs(box @ left))
        met = along[(along > 0.0) & (np.abs(aside) < half)] - front
        return max(0.0, float(met.min(initial=math.inf)))


def described(urdf: str) -> Description | None:
    """Parse a robot's URDF; return None if it is invalid."""
    try:
        robot = parse_description(urdf, "robot_description")
        robot.require_tree()
    except OneBotError:
        return None
    return robot


class Obstacles:
    """Follows the sensors of the robot that is steered, in the node's thread.

    Attributes:
        robot: its description; None if that is not known.
    """

    def __init__(
        self, topics: FollowedTopics, odometry: OdometryTopic, command: Callable[[], Velocity]
    ) -> None:
        """Follow nothing yet.

        Args:
            topics: what the node follows.
            odometry: gives the direction while the command is zero.
            command: returns the current command.
        """
        self._topics, self._odometry, self._command = topics, odometry, command
        self._description: String | None = None
        self._footprint: Footprint | None = None
        self.robot: Description | None = None

    @property
    def clearance(self) -> float | None:
        """How far the robot can go until it meets an obstacle, m; None if none is known."""
        footprint, odometry = self._footprint, self._odometry.sample
        if footprint is None or odometry is None:
            return None
        velocity = self._command()
        if velocity.speed < _STANDING:
            x, y, _ = odometry.linear
            velocity = Velocity(float(x), float(odometry.angular[2]), float(y))
        if velocity.speed < _STANDING:
            return None
        base = odometry.child_frame_id.removeprefix("/")  # usually the root link
        nearest, tree = math.inf, self._topics.tree
        for message in self._topics.recent(_SENSORS, _OLD):
            pose = tree.pose(message.header.frame_id.removeprefix("/"), base)
            if pose is not None:
                is_range = isinstance(message, Range)
                readings = (Readings.from_range if is_range else Readings.from_scan)(message)
                points = footprint.obstacles(readings, pose)
                nearest = min(nearest, footprint.clearance(points, velocity))
        return nearest if nearest < math.inf else None

    def needed(self, namespace: RobotNamespace, watched: bool) -> dict[str, str]:
        """Return the topics to follow, with their types; call this several times per second.

        Args:
            namespace: namespace of the robot.
            watched: whether there is a page.
        """
        topic = f"{namespace.name}/robot_description"
        message = self._topics.newest(topic).message
        if message is not self._description:
            self._description, self._footprint = message, None
            self.robot = described(message.data) if message is not None else None
            if self.robot is not None:
                # Loading meshes takes seconds, and must not block the node.
                threading.Thread(target=self._measure, args=(self.robot,), daemon=True).start()
        return namespace.topics(self._topics.node, _SENSORS) | {topic: _STRING} if watched else {}

    def _measure(self, robot: Description) -> None:
        footprint = Footprint.from_description(robot)
        if self.robot is robot:
            self._footprint = footprint
