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
from std_msgs.msg import Header

from onebot_control.navigation.grid import placed
from onebot_control.navigation.map_files import load_map, save_map
from onebot_control.navigation.navigator import Navigator
from onebot_control.occupancy_grid import OccupancyGrid
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import PlanarPose, about_z
from onebot_description.ros.topic_qos import LATCHED
from onebot_description.ros.wire.interfaces import load_interface

_SLOW = 1.0  # s between two maps
_QUICK = 0.2  # s between two paths
PLANAR = np.ix_((0, 1, 5), (0, 1, 5))  # x, y and yaw in the covariance of a pose


def pose_message(pose: PlanarPose) -> Pose:
    """Return a planar pose as a message."""
    message = Pose()
    message.position.x, message.position.y = pose.x, pose.y
    *_, message.orientation.z, message.orientation.w = about_z(pose.yaw)
    return message


def grid_message(grid: OccupancyGrid, header: Header) -> GridMessage:
    """Return a map as a message."""
    message = GridMessage(header=header)
    message.info.map_load_time = header.stamp
    message.info.resolution = grid.resolution
    message.info.height, message.info.width = grid.data.shape
    message.info.origin = pose_message(PlanarPose(*grid.origin))
    message.data = grid.data.tobytes()
    return message


def costs_as_occupancy(costs: OccupancyGrid) -> OccupancyGrid:
    """Convert costs, 0 to 255, to Nav2's values of an OccupancyGrid, -1 to 100."""
    table = np.zeros(256, np.int8)
    table[1:253] = 1 + 97 * (np.arange(1, 253) - 1) // 251
    table[253:] = 99, 100, -1  # inscribed, lethal, unknown
    return OccupancyGrid(table[costs.data], costs.resolution, costs.origin)


class MapTopics:
    """Publishes map, costs, path, footprint and pose, and offers Nav2's services for them."""

    def __init__(
        self, node: Node, navigator: Callable[[], Navigator], stop: Callable[[str], None]
    ) -> None:
        """Create publishers and services.

        Args:
            node: the navigator's node.
            navigator: returns the navigator; raises OneBotError while there is none.
            stop: ends the goal, with a reason.
        """
        self._node, self._navigator, self._stop = node, navigator, stop
        self._frame = node.get_parameter("global_frame").value
        frequency = node.get_parameter("controller_frequency").value
        self._slow, self._quick = (round(period * frequency) or 1 for period in (_SLOW, _QUICK))
        self._cycles = 0
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
        self._was_planned = False
        self._offer_services()

    def step(self, navigator: Navigator) -> None:
        """Publish everything that is due and has subscribers."""
        if self._cycles % self._quick == 0:
            self._publish_often(navigator)
        if self._cycles % self._slow == 0:
            if navigator.map.log_odds.size:
                self._map.publish(grid_message(navigator.map.occupancy(), self._header()))
                self._publish_costs(navigator)
            self.publish_pose(navigator)
        self._cycles += 1

    def publish_pose(self, navigator: Navigator) -> None:
        """Publish amcl_pose."""
        message = PoseWithCovarianceStamped(header=self._header())
        message.pose.pose = pose_message(navigator.pose)
        covariance = np.zeros((6, 6))
        covariance[PLANAR] = navigator.localizer.covariance
        message.pose.covariance = covariance.ravel()
        self._pose.publish(message)

    def _publish_costs(self, navigator: Navigator) -> None:
        publishers = [costs for costs in self._costs if costs.get_subscription_count()]
        if publishers:
            message = grid_message(costs_as_occupancy(navigator.costs()), self._header())
            for publisher in publishers:
                publisher.publish(message)

    def _publish_often(self, navigator: Navigator) -> None:
        if navigator.navigating or self._was_planned:
            self._was_planned = navigator.navigating
            if self._plan.get_subscription_count():
                self._plan.publish(self.path_message(navigator.path))
        if self._footprint.get_subscription_count():
            message = PolygonStamped(header=self._header())
            corners = placed(navigator.vehicle.footprint, navigator.pose).tolist()
            message.polygon.points = [Point32(x=x, y=y) for x, y in corners]
            self._footprint.publish(message)

    def path_message(self, points: Any) -> PathMessage:
        """Return points (N, 2) of the map as a path of poses that face the next point."""
        message = PathMessage(header=self._header())
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
        return PoseStamped(header=self._header(), pose=pose_message(pose))

    def _header(self) -> Header:
        return Header(frame_id=self._frame, stamp=self._node.get_clock().now().to_msg())

    # Services ---------------------------------------------------------------------------------

    def _offer_services(self) -> None:
        self._around = load_interface("nav2_msgs/srv/ClearCostmapAroundRobot").Request
        load, save = (load_interface(f"nav2_msgs/srv/{kind}Map") for kind in ("Load", "Save"))
        self._offer(GetMap, "map_server/map", self._fill_map)
        self._offer(load, "map_server/load_map", self._load)
        self._offer(save, "map_saver/save_map", self._save)
        for name in ("global", "local"):
            for kind, service, action in (
                ("GetCostmap", "get_costmap", self._fill_costs),
                ("ClearEntireCostmap", f"clear_entirely_{name}_costmap", self._clear),
                ("ClearCostmapExceptRegion", "clear_costmap_except_region", self._clear),
                ("ClearCostmapAroundRobot", "clear_costmap_around_robot", self._clear),
            ):
                interface = load_interface(f"nav2_msgs/srv/{kind}")
                self._offer(interface, f"{name}_costmap/{service}", action)

    def _offer(self, kind: Any, name: str, action: Callable[[Any, Any], None]) -> None:
        """Offer a service; an error of ``action`` is logged."""

        def respond(request: Any, response: Any) -> Any:
            try:
                action(request, response)
            except OneBotError as error:
                self._node.get_logger().error(f"{name}: {error}")
            return response

        self._node.create_service(kind, name, respond)

    def _fill_map(self, _: Any, response: Any) -> None:
        grid = self._navigator().map.occupancy()
        response.map = grid_message(grid, self._header())

    def _load(self, request: Any, response: Any) -> None:
        response.result = response.RESULT_INVALID_MAP_DATA
        grid = load_map(Path(request.map_url.removeprefix("file://")))
        self._stop("another map was loaded")
        self._navigator().use_map(grid)
        response.map = grid_message(grid, self._header())
        response.result = response.RESULT_SUCCESS

    def _save(self, request: Any, response: Any) -> None:
        grid = self._navigator().map.occupancy()
        save_map(grid, request.map_url.removeprefix("file://") or "map")
        response.result = True

    def _fill_costs(self, _: Any, response: Any) -> None:
        costs, specs = self._navigator().costs(), response.map.metadata
        response.map.header = self._header()
        specs.size_y, specs.size_x = costs.data.shape
        specs.resolution, specs.origin = costs.resolution, pose_message(PlanarPose(*costs.origin))
        response.map.data = costs.data.tobytes()

    def _clear(self, request: Any, _: Any) -> None:
        if isinstance(request, self._around):
            if not math.isfinite(request.reset_distance):
                raise OneBotError("reset_distance must be finite")
            self._navigator().forget_near(request.reset_distance)
        else:
            self._navigator().clear()
