"""The data of the page's map: the robot, its scans, its path and the map.

They are shown in the frame ``map`` if the robot's odometry is below it, or else in the root of its
tree. There are no subscriptions while no page shows the map.
"""

import io
import math
import time
from typing import Any

import numpy as np
from nav_msgs.msg import OccupancyGrid
from PIL import Image

from onebot_bringup.steering.followed_topics import FollowedTopics, RobotNamespace
from onebot_bringup.steering.obstacles import Readings
from onebot_bringup.steering.odometry_topic import OdometryTopic
from onebot_description.geometry.matrices import of_transform, to_planar, transformed
from onebot_description.geometry.poses import Transform, of_arrays
from onebot_description.ros.wire.cdr import nanoseconds
from onebot_description.ros.wire.message_arrays import OdometrySample

_MAP = "map"  # the name of the topic, and of the frame
_GRID, _SCAN = "nav_msgs/msg/OccupancyGrid", "sensor_msgs/msg/LaserScan"
_PATH, _POLYGON = "nav_msgs/msg/Path", "geometry_msgs/msg/PolygonStamped"
_NAVIGATOR = {"plan": _PATH, "local_costmap/published_footprint": _POLYGON}  # also Nav2's
_KNOWN = np.arange(256) <= 100  # whether a cell's byte is a percentage; others are unknown
_SHADES = np.where(_KNOWN, 255 - np.arange(256) * 255 // 100, 0).astype(np.uint8)
_ALPHA = (_KNOWN * 255).astype(np.uint8).tobytes()
_UNUSED = 3.0  # s without a request after which it unsubscribes
_OLD = 5.0  # s after which a scan is no longer shown
_SETTLING = 0.8  # s to wait for the first transforms


def picture(grid: OccupancyGrid) -> bytes:
    """Return a PNG with a pixel per cell: free white, occupied black, unknown transparent."""
    info = grid.info
    cells = np.frombuffer(grid.data, np.uint8).reshape(info.height, info.width)
    image = Image.fromarray(cells[::-1], "P")
    image.putpalette(_SHADES.repeat(3).tolist())
    file = io.BytesIO()
    image.save(file, "PNG", compress_level=1, transparency=_ALPHA)
    return file.getvalue()


class Ground:
    """The map's data, followed while pages show it; call it only in the node's thread."""

    def __init__(self, topics: FollowedTopics, odometry: OdometryTopic) -> None:
        self._node, self._topics, self._odometry = topics.node, topics, odometry
        self._used = self._since = -math.inf  # the last request, and the first since the last pause
        self._map = f"/{_MAP}"  # its topic

    def needed(self, namespace: RobotNamespace) -> dict[str, str]:
        """Return the topics to follow: the robot's map, or the common map, and its scans.

        Call this several times per second.
        """
        if time.monotonic() > self._used + _UNUSED:
            return {}
        own_map = f"{namespace.name}/{_MAP}"
        self._map = own_map if self._node.count_publishers(own_map) else f"/{_MAP}"
        navigator = {f"{namespace.name}/{name}": kind for name, kind in _NAVIGATOR.items()}
        return namespace.topics(self._node, {_SCAN}) | {self._map: _GRID} | navigator

    @property
    def grid(self) -> OccupancyGrid | None:
        """The newest map, if it is valid; from any thread."""
        grid: OccupancyGrid | None = self._topics.newest(self._map).message
        if grid is None:
            return None
        info = grid.info
        cells = info.width * info.height if 0.0 < info.resolution < math.inf else 0
        return grid if 0 < cells == len(grid.data) else None

    def fields(self, frame: str = "") -> dict[str, Any]:
        """Return what a page shows in ``frame``; "" for the usual one (see the module).

        Poses and sizes are in m and rad, None if unknown. The result is empty at first, since the
        frame could be wrong before the transforms have arrived.
        """
        now = time.monotonic()
        if now > self._used + _UNUSED:
            self._since = now
        self._used = now
        if now < self._since + _SETTLING:
            return {}
        odometry = self._odometry.sample
        frame = frame or self._frame(odometry)
        robot = None
        if odometry is not None and self._odometry.age < _OLD:
            pose = of_arrays(odometry.translation, odometry.rotation)
            robot = self._pose(frame, odometry.frame_id, pose)
        base = odometry.child_frame_id if odometry is not None else ""
        return {
            "frame": frame,
            "base": base,
            "robot": robot,
            "map": self._grid_fields(frame),
            "scans": self._scan_points(frame),
            "path": self._line(_PATH, frame),
            "footprint": self._line(_POLYGON, frame),
        }

    def _line(self, kind: str, frame: str) -> list[list[float]]:
        """Return the points of the newest path or polygon, x and y; none if it is old."""
        for message in self._topics.recent({kind}, _OLD):
            points = (
                [pose.pose.position for pose in message.poses]
                if kind == _PATH
                else message.polygon.points
            )
            pose = self._topics.tree.pose(message.header.frame_id.removeprefix("/"), frame)
            if pose is not None and len(points):
                corners = np.array([(point.x, point.y, point.z) for point in points])
                found: list[list[float]] = transformed(corners, pose)[:, :2].round(3).tolist()
                return found
        return []

    def _scan_points(self, frame: str) -> list[list[float]]:
        """Return the points that the scans hit, x and y, with their sensors' poses at that time."""
        points = []
        for scan in self._topics.recent({_SCAN}, _OLD):
            sensor = scan.header.frame_id.removeprefix("/")
            pose = self._topics.tree.pose(sensor, frame, nanoseconds(scan.header.stamp))
            if pose is not None:
                points += Readings.from_scan(scan).points(pose)[:, :2].round(3).tolist()
        return points

    def _frame(self, odometry: OdometrySample | None) -> str:
        buffer = self._topics.tree
        if odometry is None:
            return _MAP if _MAP in buffer.names else next(iter(buffer.roots), "")
        above = buffer.above(odometry.frame_id.removeprefix("/"))
        return next((name for name in above if name.rpartition("/")[2] == _MAP), above[-1])

    def _grid_fields(self, frame: str) -> dict[str, Any] | None:
        grid = self.grid
        if grid is None:
            return None
        info, origin = grid.info, grid.info.origin
        place, turn = origin.position, origin.orientation
        corner = Transform((place.x, place.y, place.z), (turn.x, turn.y, turn.z, turn.w))
        pose = self._pose(frame, grid.header.frame_id, corner)
        size = {"width": info.width * info.resolution, "height": info.height * info.resolution}
        version = str(self._topics.newest(self._map).time)  # differs between maps
        return {"version": version, **pose, **size} if pose is not None else None

    def _pose(self, frame: str, of: str, transform: Transform) -> dict[str, float] | None:
        """Transform a pose in the frame ``of`` to ``frame``; None if that is not possible."""
        matrix = self._topics.tree.pose(of.removeprefix("/"), frame)
        if matrix is None:
            return None
        pose = to_planar(matrix @ of_transform(transform))._asdict()
        return pose if all(map(math.isfinite, pose.values())) else None
