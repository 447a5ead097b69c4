"""The topics of the navigator's map, costs, path and pose, and Nav2's map server services."""

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import Point32, PolygonStamped, Pose, PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid as GridMessage
from nav_msgs.msg import Path as PathMessage
from nav_msgs.srv import GetMap
from rclpy.node import Node

from onebot_control.navigation.map_files import load_map, save_map
from onebot_control.navigation.navigator import Navigator
from onebot_control.occupancy_grid import OccupancyGrid
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import PlanarPose, about_z
from onebot_description.ros.topic_qos import LATCHED
from onebot_description.ros.wire.interfaces import load_interface

_COSTS = (253, 99), (254, 100), (255, -1)  # inscribed, lethal, unknown in an OccupancyGrid
_SLOW = 1.0  # s between two maps
_QUICK = 0.2  # s between two paths
_UNCLEARED = "nothing to clear"


def pose_message(pose: PlanarPose) -> Pose:
    """Return a planar pose as a message."""
    message = Pose()
    message.position.x, message.position.y = pose.x, pose.y
    *_, message.orientation.z, message.orientation.w = about_z(pose.yaw)
    return message


def grid_message(grid: OccupancyGrid, frame: str, stamp: Any) -> GridMessage:
    """Return a map as a message."""
    message = GridMessage()
    message.header.frame_id, message.header.stamp = frame, stamp
    message.info.map_load_time = stamp
    message.info.resolution = grid.resolution
    message.info.height, message.info.width = grid.data.shape
    message.info.origin = pose_message(PlanarPose(*grid.origin))
    message.data = np.ascontiguousarray(grid.data, np.int8).ravel().tobytes()
    return message


def costs_as_occupancy(costs: OccupancyGrid) -> OccupancyGrid:
    """Convert costs, 0 to 255, to Nav2's values of an OccupancyGrid, -1 to 100."""
    table = np.zeros(256, np.int8)
    table[1:253] = 1 + 97 * (np.arange(1, 253) - 1) // 251
    for cost, value in _COSTS:
        table[cost] = value
    return OccupancyGrid(table[costs.data], costs.resolution, costs.origin)


class MapTopics:
    """Publishes map, costs, path, footprint and pose, and offers Nav2's services for them."""

    def __init__(
        self, node: Node, frame: str, navigator: Callable[[], Navigator], use: Callable[[Any], None]
    ) -> None:
        """Create publishers and services.

        Args:
            node: the navigator's node.
            frame: frame of the map.
            navigator: returns the navigator; raises OneBotError while there is none.
            use: called with a new OccupancyGrid to localize in.
        """
        self._node, self._frame, self._navigator, self._use = node, frame, navigator, use
        self._map = node.create_publisher(GridMessage, "map", LATCHED)
        self._costs = [
            node.create_publisher(GridMessage, f"{name}_costmap/costmap", LATCHED)
            for name in ("global", "local")
        ]
        self._footprint = node.create_publisher(
            PolygonStamped, "local_costmap/published_footprint", 1
        )
        self._plan = node.create_publisher(PathMessage, "plan", 1)
        self._pose = node.create_publisher(PoseWithCovarianceStamped, "amcl_pose", LATCHED)
        self._slow = self._quick = -math.inf
        self._was_planned = False
        self._offer_services()

    def step(self, navigator: Navigator) -> None:
        """Publish everything that is due and has subscribers."""
        if not 0.0 <= navigator.time - self._quick < _QUICK:
            self._quick = navigator.time
            self._publish_often(navigator)
        if not 0.0 <= navigator.time - self._slow < _SLOW:
            self._slow = navigator.time
            stamp = self._stamp()
            if navigator.map.log_odds.size:
                self._map.publish(grid_message(navigator.map.occupancy(), self._frame, stamp))
                if watched := [each for each in self._costs if each.get_subscription_count()]:
                    costs = costs_as_occupancy(navigator.costs())
                    for publisher in watched:
                        publisher.publish(grid_message(costs, self._frame, stamp))
            self.publish_pose(navigator)

    def publish_pose(self, navigator: Navigator) -> None:
        """Publish amcl_pose."""
        message = PoseWithCovarianceStamped()
        message.header.frame_id, message.header.stamp = self._frame, self._stamp()
        message.pose.pose = pose_message(navigator.pose)
        covariance = np.zeros((6, 6))
        rows = (0, 1, 5)
        covariance[np.ix_(rows, rows)] = navigator.localizer.covariance
        message.pose.covariance = covariance.ravel()
        self._pose.publish(message)

    def _publish_often(self, navigator: Navigator) -> None:
        if navigator.navigating or self._was_planned:
            self._was_planned = navigator.navigating
            if self._plan.get_subscription_count():
                self._plan.publish(self.path_message(navigator.path))
        if self._footprint.get_subscription_count():
            message = PolygonStamped()
            message.header.frame_id, message.header.stamp = self._frame, self._stamp()
            message.polygon.points = [Point32(x=x, y=y) for x, y in navigator.footprint.tolist()]
            self._footprint.publish(message)

    def path_message(self, points: Any) -> PathMessage:
        """Return points (N, 2) of the map as a path of poses that face the next point."""
        message = PathMessage()
        message.header.frame_id, message.header.stamp = self._frame, self._stamp()
        points = np.asarray(points, float)
        steps = np.diff(points, axis=0, append=points[-1:])
        yaws = np.arctan2(steps[:, 1], steps[:, 0])
        if len(yaws) > 1:
            yaws[-1] = yaws[-2]
        for (x, y), yaw in zip(points.tolist(), yaws.tolist(), strict=True):
            pose = PoseStamped(header=message.header, pose=pose_message(PlanarPose(x, y, yaw)))
            message.poses.append(pose)
        return message

    def pose_stamped(self, pose: PlanarPose) -> PoseStamped:
        """Return a pose in the map as a message, stamped now."""
        message = PoseStamped(pose=pose_message(pose))
        message.header.frame_id, message.header.stamp = self._frame, self._stamp()
        return message

    def _stamp(self) -> Any:
        return self._node.get_clock().now().to_msg()

    # Services ---------------------------------------------------------------------------------

    def _offer_services(self) -> None:
        self._around = load_interface("nav2_msgs/srv/ClearCostmapAroundRobot").Request
        self._offer(GetMap, "map_server/map", self._fill_map, "no map yet")
        load, save = (load_interface(f"nav2_msgs/srv/{kind}Map") for kind in ("Load", "Save"))
        self._offer(load, "map_server/load_map", self._load, "map not loaded")
        self._offer(save, "map_saver/save_map", self._save, "map not saved")
        for name in ("global", "local"):
            for kind, service, action, problem in (
                ("GetCostmap", "get_costmap", self._fill_costs, "no costs yet"),
                ("ClearEntireCostmap", f"clear_entirely_{name}_costmap", self._clear, _UNCLEARED),
                (
                    "ClearCostmapExceptRegion",
                    "clear_costmap_except_region",
                    self._clear,
                    _UNCLEARED,
                ),
                ("ClearCostmapAroundRobot", "clear_costmap_around_robot", self._clear, _UNCLEARED),
            ):
                interface = load_interface(f"nav2_msgs/srv/{kind}")
                self._offer(interface, f"{name}_costmap/{service}", action, problem)

    def _offer(
        self, kind: Any, name: str, action: Callable[[Any, Any], None], problem: str
    ) -> None:
        """Offer a service; an error of ``action`` is logged as a ``problem``."""

        def respond(request: Any, response: Any) -> Any:
            try:
                action(request, response)
            except OneBotError as error:
                self._node.get_logger().error(f"{problem}: {error}")
            return response

        self._node.create_service(kind, name, respond)

    def _fill_map(self, _: Any, response: Any) -> None:
        grid = self._navigator().map.occupancy()
        response.map = grid_message(grid, self._frame, self._stamp())

    def _load(self, request: Any, response: Any) -> None:
        response.result = response.RESULT_INVALID_MAP_DATA
        grid = load_map(Path(request.map_url.removeprefix("file://")))
        self._use(grid)
        response.map = grid_message(grid, self._frame, self._stamp())
        response.result = response.RESULT_SUCCESS

    def _save(self, request: Any, response: Any) -> None:
        grid = self._navigator().map.occupancy()
        save_map(grid, request.map_url.removeprefix("file://") or "map")
        response.result = True

    def _fill_costs(self, _: Any, response: Any) -> None:
        costs, specs = self._navigator().costs(), response.map.metadata
        response.map.header.frame_id, response.map.header.stamp = self._frame, self._stamp()
        specs.size_y, specs.size_x = costs.data.shape
        specs.resolution, specs.origin = costs.resolution, pose_message(PlanarPose(*costs.origin))
        response.map.data = costs.data.tobytes()

    def _clear(self, request: Any, _: Any) -> None:
        if isinstance(request, self._around):
            self._navigator().forget_near(request.reset_distance)
        else:
            self._navigator().clear()
