"""Nav2's actions: each row of the table converts the requests of one to navigator goals."""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from rclpy.action import CancelResponse, GoalResponse
from rclpy.clock import Clock
from rclpy.duration import Duration
from rclpy.node import Node

from onebot_control.navigation.goals import Goal, Goals
from onebot_control.navigation.navigator import Failure, NavigationError, Navigator
from onebot_control.nodes.controller_node import RESULT_KEPT, DeferredAction
from onebot_control.nodes.navigation.maps import MapTopics
from onebot_description.arrays import Floats
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import PlanarPose
from onebot_description.ros.wire.cdr import nanoseconds
from onebot_description.ros.wire.interfaces import load_interface
from onebot_description.timing import NS_PER_S

_EASY = 0.3  # minimum share of the maximum speed in the estimate of the remaining time
_PLUGINS = "behavior_tree", "planner_id", "controller_id", "goal_checker_id", "smoother_id"
_DEFAULT_PLUGINS = {"", "GridBased", "FollowPath", "simple_smoother", "general_goal_checker"}


class Context(NamedTuple):
    """The environment of the actions."""

    node: Node
    goals: Goals
    maps: MapTopics
    to_map: Callable[[Any], PlanarPose]  # converts a PoseStamped; raises OneBotError
    navigator: Callable[[], Navigator]  # raises OneBotError while there is none
    prepare: Callable[[], None]  # raises OneBotError if the robot cannot drive now


def _poses(context: Context, poses: Sequence[Any]) -> list[PlanarPose]:
    if not poses:
        raise NavigationError(Failure.NO_VIAPOINTS_GIVEN)
    return [context.to_map(pose) for pose in poses]


def _to_pose(context: Context, request: Any, _: Any) -> Goal:
    return Goal(_poses(context, [request.pose]))


def _through_poses(context: Context, request: Any, _: Any) -> Goal:
    return Goal(_poses(context, request.poses))


def _waypoints(context: Context, request: Any, _: Any) -> Goal:
    poses, index = _poses(context, request.poses), int(request.goal_index)
    if index >= len(poses):
        raise ValueError(f"goal_index is {index} of {len(poses)} poses")
    gives_up = bool(context.node.get_parameter("stop_on_failure").value)
    loops = int(request.number_of_loops)
    return Goal(poses, stops=True, stops_on_failure=gives_up, loops=loops, index=index)


def _follow_path(context: Context, request: Any, _: Any) -> Goal:
    points, yaw = _points(context, request.path)
    return Goal(motion=lambda navigator: navigator.follow(points, yaw))


def _points(context: Context, path: Any) -> tuple[Floats, float | None]:
    """Return the points of a path, (N, 2), and the heading at its end."""
    for stamped in path.poses:
        stamped.header.frame_id = stamped.header.frame_id or path.header.frame_id
    poses = np.array([context.to_map(stamped) for stamped in path.poses]).reshape(-1, 3)
    return poses[:, :2], float(poses[-1, 2]) if len(poses) else None


def _spin(_context: Context, request: Any, _: Any) -> Goal:
    angle, allowance = request.target_yaw, _seconds(request.time_allowance)
    return Goal(motion=lambda navigator: navigator.spin(angle, allowance))


def _straight(sign: float, _context: Context, request: Any, _: Any) -> Goal:
    distance, speed = request.target.x, abs(request.speed)
    if request.target.y or request.target.z:
        raise ValueError("target has only x, the distance")
    if sign > 0.0 and distance * request.speed < 0.0:
        raise ValueError("target.x and speed have different signs")
    if sign < 0.0:  # Nav2 backs up regardless of the signs
        distance = -abs(distance)
    allowance = _seconds(request.time_allowance)
    return Goal(motion=lambda navigator: navigator.drive_straight(distance, speed, allowance))


def _wait(_context: Context, request: Any, _: Any) -> Goal:
    return Goal(lasts=max(_seconds(request.time), 1e-3))


def _seconds(duration: Any) -> float:
    return nanoseconds(duration) / NS_PER_S


def _plan(context: Context, request: Any, result: Any) -> None:
    start = context.to_map(request.start) if request.use_start else None
    parts = []
    for stop in _poses(context, request.goals if hasattr(request, "goals") else [request.goal]):
        parts.append(context.navigator().plan(stop, start))
        start = stop
    result.path = context.maps.path_message(np.concatenate(parts))


def _smooth(context: Context, request: Any, result: Any) -> None:
    """Average neighboring points: this rounds corners and keeps the ends."""
    points, _ = _points(context, request.path)
    if not len(points):
        raise NavigationError(Failure.INVALID_PATH)
    for _ in range(5):
        points[1:-1] = (points[:-2] + 2.0 * points[1:-1] + points[2:]) / 4.0
    result.path, result.was_completed = context.maps.path_message(points), True


class ActionRow(NamedTuple):
    """An action of Nav2: ``convert`` returns its goal, or fills the result if it has none."""

    name: str
    kind: str  # its type in nav2_msgs
    convert: Callable[[Context, Any, Any], Goal | None]
    drives: bool = True


ACTIONS = (
    ActionRow("navigate_to_pose", "NavigateToPose", _to_pose),
    ActionRow("navigate_through_poses", "NavigateThroughPoses", _through_poses),
    ActionRow("follow_waypoints", "FollowWaypoints", _waypoints),
    ActionRow("follow_path", "FollowPath", _follow_path),
    ActionRow("spin", "Spin", _spin),
    ActionRow("backup", "BackUp", partial(_straight, -1.0)),
    ActionRow("drive_on_heading", "DriveOnHeading", partial(_straight, 1.0)),
    ActionRow("wait", "Wait", _wait),
    ActionRow("compute_path_to_pose", "ComputePathToPose", _plan, drives=False),
    ActionRow("compute_path_through_poses", "ComputePathThroughPoses", _plan, drives=False),
    ActionRow("smooth_path", "SmoothPath", _smooth, drives=False),
)


class _WithClock:
    """A node with a clock of its own, for one action.

    rclpy's events executor warns about many timers on one clock, and each action has a timer.
    """

    def __init__(self, node: Node) -> None:
        self._node, self._clock = node, Clock()

    def get_clock(self) -> Clock:
        """Return its clock."""
        return self._clock

    def __getattr__(self, name: str) -> Any:
        return getattr(self._node, name)


class NavigationAction:
    """One of the actions."""

    def __init__(self, context: Context, row: ActionRow) -> None:
        """Offer the action."""
        self._context, self._row = context, row
        self._log_error = context.node.get_logger().error
        self._type = load_interface(f"nav2_msgs/action/{row.kind}")
        self._action = DeferredAction(
            _WithClock(context.node),
            self._type,
            row.name,
            lambda goal: self._type.Result(),
            goal_callback=self._on_goal,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
            result_timeout=RESULT_KEPT,
        )

    def _on_goal(self, request: Any) -> GoalResponse:
        try:
            for name in _PLUGINS:
                value = getattr(request, name, "")
                if value not in _DEFAULT_PLUGINS:
                    raise OneBotError(f'there is no {name} "{value}": leave it empty')
            self._context.navigator()
            if self._row.drives:
                self._context.prepare()
        except OneBotError as error:
            self._log_error(f"{self._row.name}: goal rejected: {error}")
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _on_accepted(self, handle: Any) -> None:
        handle.execute()
        result, began = self._type.Result(), self._context.node.get_clock().now()
        try:
            goal = self._row.convert(self._context, handle.request, result)
            if goal is not None:
                goal.client, goal.handle = self, handle
                self._context.goals.start(goal)
                return
            self._finish(handle, result, self._context.node.get_clock().now() - began)
        except (OneBotError, ValueError) as error:
            self._log_error(f"{self._row.name}: {error}")
            code = "TF_ERROR" if isinstance(error, OneBotError) else "INVALID_INPUT"
            if isinstance(error, NavigationError):
                code = error.failure.name
            result.error_code, result.error_msg = self._code(code), str(error)
            self._finish(handle, result)

    def _finish(self, handle: Any, result: Any, elapsed: Duration | None = None) -> None:
        """Send a result, with the elapsed time if it has a field for it."""
        for name, kind in self._type.Result.get_fields_and_field_types().items():
            if elapsed is not None and kind == "builtin_interfaces/Duration":
                setattr(result, name, elapsed.to_msg())

        def end(handle: Any) -> Any:
            if handle.is_cancel_requested:
                handle.canceled()
            elif result.error_code:
                handle.abort()
            else:
                handle.succeed()
            return result

        self._action.finish(handle, end)

    def _on_cancel(self, _: Any) -> CancelResponse:
        self._context.goals.cancel("the client cancelled it", self)
        return CancelResponse.ACCEPT

    def _code(self, name: str) -> int:
        """Return Nav2's code of an error, of this action or of the server that it would call."""
        planner = "ThroughPoses" if self._row.kind == "NavigateThroughPoses" else "ToPose"
        kinds = self._row.kind, f"ComputePath{planner}", "FollowPath"
        results = [load_interface(f"nav2_msgs/action/{kind}").Result for kind in kinds]
        codes = [getattr(result, key, 0) for key in (name, "UNKNOWN") for result in results]
        return int(next(filter(None, codes)))

    def feed(self, goal: Goal, navigator: Navigator) -> None:
        """Send feedback."""
        feedback, remaining = self._type.Feedback(), navigator.distance_remaining
        elapsed = navigator.time - goal.began
        speed = math.hypot(*navigator.speed[:2])
        seconds = remaining / max(speed, _EASY * navigator.vehicle.forward)
        values = {
            "current_pose": self._context.maps.pose_stamped(navigator.pose),
            "navigation_time": Duration(seconds=elapsed).to_msg(),
            "estimated_time_remaining": Duration(seconds=seconds).to_msg(),
            "number_of_recoveries": navigator.recoveries,
            "distance_remaining": remaining,
            "distance_to_goal": remaining,
            "speed": speed,
            "number_of_poses_remaining": len(goal.poses) - goal.index,
            "current_waypoint": goal.index,
            "angular_distance_traveled": navigator.traveled,
            "distance_traveled": navigator.traveled,
            "time_left": Duration(seconds=max(0.0, goal.lasts - elapsed)).to_msg(),
        }
        for name in feedback.get_fields_and_field_types():
            setattr(feedback, name, values[name])
        goal.handle.publish_feedback(feedback)

    def ended(self, goal: Goal, reason: str, failure: Failure | None) -> None:
        """Send the result to the client."""
        result = self._type.Result()
        for index, missed in goal.missed:
            waypoint = load_interface("nav2_msgs/msg/MissedWaypoint")(index=index)
            waypoint.goal = self._context.maps.pose_stamped(goal.poses[index])
            waypoint.error_code = self._code(missed.name)
            result.missed_waypoints.append(waypoint)
        if reason:
            result.error_code = self._code(failure.name if failure else "UNKNOWN")
            result.error_msg = reason
        elapsed = self._context.navigator().time - goal.began
        self._finish(goal.handle, result, Duration(seconds=elapsed))
