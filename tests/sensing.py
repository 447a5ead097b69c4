"""Sensors of OneBot in a world, for the READMEs' picture: a scan, a cloud, a map, a plan, markers.

``python -m tests.sensing WORLD``, beside ``onebot_bringup``: a node that follows the
robot in a PyBullet of its own, and publishes five times a second what sensors would measure.
"""

import sys
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pybullet
from geometry_msgs.msg import Point, PoseStamped
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from numpy.typing import NDArray
from rclpy.node import Node
from sensor_msgs.msg import Image, LaserScan, PointCloud2, PointField
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from onebot_description.description.worlds import load_world
from onebot_description.node import LATCHED, run_node

Floats = NDArray[np.float64]

PERIOD = 0.2  # seconds
LIDAR_HEIGHT, CAMERA_HEIGHT = 0.1, 0.12  # metres above base_link
RAYS, REACH = 720, 6.0
CELL, EXTENT = 0.02, (-0.6, 3.0)  # metres: of the map, in x and in y
WIDTH, HEIGHT = 320, 240
# Through the maze's first cells, metres.
CORNERS = ((0.0, 0.0), (1.0, -0.1), (1.65, 0.1), (1.8, 0.6), (1.2, 0.8), (0.1, 0.9))


class Surroundings:
    """The world, for rays and pictures; nothing moves in it."""

    def __init__(self, world: str) -> None:
        """Load the world."""
        self.client = pybullet.connect(pybullet.DIRECT)
        with TemporaryDirectory() as folder:
            file = f"{folder}/world.urdf"
            with open(file, "w", encoding="utf-8") as output:
                output.write(load_world(world).urdf)
            pybullet.loadURDF(file, useFixedBase=True, physicsClientId=self.client)

    def distances(self, start: Floats, directions: Floats) -> Floats:
        """Return how far rays go from (3,) ``start`` along (N, 3) ``directions``, metres."""
        found: list[float] = []
        for part in np.array_split(directions, 1 + len(directions) // 5000):
            ends = start + REACH * part
            hits = pybullet.rayTestBatch(
                [start.tolist()] * len(part), ends.tolist(), physicsClientId=self.client
            )
            found += [REACH * hit[2] if hit[0] >= 0 else np.inf for hit in hits]
        return np.array(found)

    def picture(self, eye: Floats, ahead: Floats) -> NDArray[np.uint8]:
        """Return what a camera sees, (HEIGHT, WIDTH, 3)."""
        view = pybullet.computeViewMatrix(eye, eye + ahead, (0, 0, 1))
        lens = pybullet.computeProjectionMatrixFOV(70, WIDTH / HEIGHT, 0.02, 10.0)
        image: Any = pybullet.getCameraImage(
            WIDTH, HEIGHT, view, lens, lightDirection=(1, 0.5, 2),
            renderer=pybullet.ER_TINY_RENDERER, physicsClientId=self.client,
        )[2]  # fmt: skip
        return np.ascontiguousarray(np.reshape(image, (HEIGHT, WIDTH, 4))[..., :3], np.uint8)

    def occupied(self) -> NDArray[np.int8]:
        """Return a map, row by row: 0 or 100."""
        centers = np.arange(*EXTENT, CELL) + CELL / 2
        x, y = np.meshgrid(centers, centers)
        above = np.stack([x.ravel(), y.ravel(), np.full(x.size, 1.0)], axis=1)
        down = [[px, py, 0.05] for px, py, _ in above]
        hits: list[Any] = []
        for at in range(0, len(above), 5000):
            some = slice(at, at + 5000)
            hits += pybullet.rayTestBatch(
                above[some].tolist(), down[some], physicsClientId=self.client
            )
        found = np.array([100 if hit[0] >= 0 else 0 for hit in hits], np.int8)
        return found.reshape(x.shape)


class Sensors(Node):
    """Publishes what the sensors of the robot measure, where it truly is."""

    def __init__(self, world: str) -> None:
        """Publish the map once, the rest from now on."""
        super().__init__("sensors")
        self._around = Surroundings(world)
        self._odometry: Odometry | None = None
        self.create_subscription(Odometry, "velocity_controller/ground_truth", self._take, 10)
        self._outputs = {
            topic: self.create_publisher(kind, topic, LATCHED if topic == "map" else 10)
            for topic, kind in (
                ("scan", LaserScan), ("points", PointCloud2), ("camera/image_raw", Image),
                ("map", OccupancyGrid), ("plan", Path), ("markers", MarkerArray),
            )
        }  # fmt: skip
        self._outputs["map"].publish(self._map())
        self.create_timer(PERIOD, self._measure)
        self.get_logger().info(f"sensing the world {world}")

    def _take(self, odometry: Odometry) -> None:
        self._odometry = odometry

    def _measure(self) -> None:
        if self._odometry is None:
            return
        header, pose = self._odometry.header, self._odometry.pose.pose
        place = np.array([pose.position.x, pose.position.y, 0.06])
        yaw = 2 * np.arctan2(pose.orientation.z, pose.orientation.w)
        own = Header(stamp=header.stamp, frame_id="base_link")
        self._outputs["scan"].publish(self._scan(own, place, yaw))
        self._outputs["points"].publish(self._cloud(own, place, yaw))
        ahead = np.array([np.cos(yaw), np.sin(yaw), -0.15])
        picture = self._around.picture(place + 0.1 * ahead + (0, 0, CAMERA_HEIGHT), ahead)
        image = Image(
            header=own, width=WIDTH, height=HEIGHT, encoding="rgb8", step=3 * WIDTH,
            data=picture.tobytes(),
        )  # fmt: skip
        self._outputs["camera/image_raw"].publish(image)
        self._outputs["plan"].publish(self._plan(header))
        self._outputs["markers"].publish(self._markers(header))

    def _scan(self, header: Header, place: Floats, yaw: float) -> LaserScan:
        angles = np.linspace(-np.pi, np.pi, RAYS, endpoint=False)
        directions = np.stack([np.cos(angles + yaw), np.sin(angles + yaw), 0 * angles], axis=1)
        distances = self._around.distances(place + (0, 0, LIDAR_HEIGHT), directions)
        return LaserScan(
            header=header, angle_min=-np.pi, angle_max=np.pi, angle_increment=2 * np.pi / RAYS,
            range_min=0.05, range_max=REACH, ranges=distances.tolist(),
            intensities=np.where(np.isfinite(distances), 1 / (0.3 + distances), 0.0).tolist(),
        )  # fmt: skip

    def _cloud(self, header: Header, place: Floats, yaw: float) -> PointCloud2:
        across, up = np.meshgrid(
            np.radians(np.arange(-35, 35, 1.0)), np.radians(np.arange(-25, 15, 1.5))
        )
        local = np.stack(
            [np.cos(up) * np.cos(across), np.cos(up) * np.sin(across), np.sin(up)], axis=-1
        ).reshape(-1, 3)
        turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        start = np.array([0.1, 0.0, CAMERA_HEIGHT])
        distances = self._around.distances(place + turn @ start, local @ turn.T)
        seen = np.isfinite(distances)
        points = (start + local[seen] * distances[seen, None]).astype("<f4")
        rows = np.concatenate([points, points[:, 2:]], axis=1)
        fields = [
            PointField(name=name, offset=4 * at, datatype=PointField.FLOAT32, count=1)
            for at, name in enumerate(("x", "y", "z", "intensity"))
        ]
        return PointCloud2(
            header=header, height=1, width=len(rows), fields=fields, point_step=16,
            row_step=16 * len(rows), data=rows.tobytes(), is_dense=True,
        )  # fmt: skip

    def _map(self) -> OccupancyGrid:
        cells = self._around.occupied()
        grid = OccupancyGrid(header=Header(frame_id="odom"), data=cells.ravel().tolist())
        grid.info.resolution, grid.info.height, grid.info.width = CELL, *cells.shape
        grid.info.origin.position.x = grid.info.origin.position.y = EXTENT[0]
        grid.info.origin.position.z = -0.06
        return grid

    def _plan(self, header: Header) -> Path:
        corners = np.array(CORNERS)
        steps = np.linspace(0, len(corners) - 1, 80)
        path = Path(header=header)
        for x, y in zip(
            *(np.interp(steps, range(len(corners)), axis) for axis in corners.T), strict=True
        ):
            pose = PoseStamped(header=header)
            pose.pose.position.x, pose.pose.position.y = float(x), float(y)
            pose.pose.position.z = -0.04
            path.poses.append(pose)
        return path

    def _markers(self, header: Header) -> MarkerArray:
        goal = Marker(header=header, ns="goal", id=0, type=Marker.CYLINDER)
        goal.pose.position.x, goal.pose.position.y = CORNERS[-1]
        goal.scale.x = goal.scale.y = 0.16
        goal.scale.z, goal.color = 0.06, ColorRGBA(r=0.2, g=0.9, b=0.4, a=0.8)
        name = Marker(header=header, ns="goal", id=1, type=Marker.TEXT_VIEW_FACING, text="goal")
        name.pose.position.x, name.pose.position.y = CORNERS[-1]
        name.pose.position.z, name.scale.z, name.color = (
            0.2,
            0.1,
            ColorRGBA(r=1.0, g=1.0, b=1.0, a=1.0),
        )
        stops = Marker(header=header, ns="stops", id=0, type=Marker.SPHERE_LIST)
        stops.scale.x = stops.scale.y = stops.scale.z = 0.06
        stops.color = ColorRGBA(r=0.95, g=0.4, b=0.6, a=1.0)
        stops.points = [Point(x=x, y=y, z=0.0) for x, y in CORNERS[1:-1]]
        return MarkerArray(markers=[goal, name, stops])


if __name__ == "__main__":
    sys.exit(run_node(lambda: Sensors(sys.argv[1]), []))
