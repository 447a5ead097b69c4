"""Nav2's actions: each row of the table converts the requests of one to navigator goals."""

import math
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from rclpy.action import CancelResponse, GoalResponse
from rclpy.clock import ROSClock
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time_source import TimeSource

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

_CODES = "ComputePathToPose", "FollowPath"  # results whose codes others pass on, too
_CODES_OF_SEVERAL = "ComputePathThroughPoses", "FollowPath"
_TIMERS = 4  # number of actions that share a clock
_EASY = 0.3  # minimum share of the maximum speed in the estimate of the remaining time
_PLUGINS = "behavior_tree", "planner_id", "controller_id", "goal_checker_id", "smoother_id"
_DEFAULT_PLUGINS = {"", "GridBased", "FollowPath", "simple_smoother", "general_goal_checker"}


class RequestError(OneBotError):
    """A request cannot be executed; ``code`` is Nav2's name of the error."""

    def __init__(self, text: str, code: str) -> None:
        """Store the text and the name."""
        super().__init__(text)
        self.code = code


class Context(NamedTuple):
    """The environment of the table's rows."""

    goals: Goals
    maps: MapTopics
    to_map: Callable[[Any], PlanarPose]  # converts a PoseStamped; raises OneBotError
    navigator: Callable[[], Navigator]  # raises OneBotError while there is none
    prepare: Callable[[], None]  # raises OneBotError if the robot cannot drive now


MakeGoal = Callable[[Context, "NavigationAction", Any], Goal]
Answer = Callable[[Context, Any, Any], None]  # fills the result of a request without motion


def _poses(context: Context, poses: Sequence[Any]) -> list[PlanarPose]:
    if not poses:
        raise RequestError("there is no pose", "NO_VIAPOINTS_GIVEN")
    return [context.to_map(pose) for pose in poses]


def _to_pose(context: Context, action: "NavigationAction", request: Any) -> Goal:
    return Goal(action, _poses(context, [request.pose]))


def _through_poses(context: Context, action: "NavigationAction", request: Any) -> Goal:
    return Goal(action, _poses(context, request.poses))


def _waypoints(context: Context, action: "NavigationAction", request: Any) -> Goal:
    poses = _poses(context, request.poses)
    if request.goal_index >= len(poses):
        raise RequestError(f"goal_index is {request.goal_index} of {len(poses)} poses", "UNKNOWN")
    return Goal(
        action,
        poses,
        stops=True,
        stops_on_failure=action.stops_on_failure,
        loops=int(request.number_of_loops),
        index=int(request.goal_index),
    )


def _follow_path(context: Context, action: "NavigationAction", request: Any) -> Goal:
    points, yaw = _points(context, request.path)
    if not len(points):
        raise RequestError(Failure.INVALID_PATH.value, "INVALID_PATH")
    return Goal(action, motion=lambda navigator: navigator.follow(points, yaw))


def _points(context: Context, path: Any) -> tuple[Floats, float | None]:
    """Return the points of a path, (N, 2), and the heading at its end."""
    frame = path.header.frame_id
    poses = []
    for stamped in path.poses:
        stamped.header.frame_id = stamped.header.frame_id or frame
        poses.append(context.to_map(stamped))
    points = np.array([pose[:2] for pose in poses]).reshape(-1, 2)
    return points, poses[-1].yaw if poses else None


def _spin(_: Context, action: "NavigationAction", request: Any) -> Goal:
    allowance = _allowance(request)
    return Goal(
        action,
        motion=lambda navigator: navigator.spin(request.target_yaw, time_allowance=allowance),
    )


def _straight(sign: float, _: Context, action: "NavigationAction", request: Any) -> Goal:
    target, allowance = request.target, _allowance(request)
    if target.y or target.z:
        raise RequestError("target has only x, the distance", "INVALID_INPUT")
    distance, speed = sign * target.x, abs(request.speed)
    if sign > 0.0 and target.x * request.speed < 0.0:
        raise RequestError("target.x and speed have different signs", "INVALID_INPUT")
    if sign < 0.0:  # Nav2 backs up regardless of the signs
        distance = -abs(target.x)
    return Goal(
        action,
        motion=lambda navigator: navigator.drive_straight(
            distance, speed, time_allowance=allowance
        ),
    )


def _allowance(request: Any) -> float:
    return nanoseconds(request.time_allowance) / NS_PER_S or math.inf


def _wait(_: Context, action: "NavigationAction", request: Any) -> Goal:
    return Goal(action, lasts=max(nanoseconds(request.time) / NS_PER_S, 1e-3))


def _plan(context: Context, request: Any, result: Any) -> None:
    start = context.to_map(request.start) if request.use_start else None
    stops = getattr(request, "goals", None) or [request.goal]
    parts = []
    for stop in _poses(context, stops):
        parts.append(context.navigator().plan(stop, start))
        start = stop
    result.path = context.maps.path_message(np.concatenate(parts))


def _smooth(context: Context, request: Any, result: Any) -> None:
    """Average neighboring points: this rounds corners and keeps the ends."""
    points, _ = _points(context, request.path)
    if len(points) < 2:
        raise RequestError("the path has fewer than two poses", "INVALID_PATH")
    for _ in range(5):
        points[1:-1] = (points[:-2] + 2.0 * points[1:-1] + points[2:]) / 4.0
    result.path, result.was_completed = context.maps.path_message(points), True


class ActionRow(NamedTuple):
    """An action."""

    name: str
    kind: str  # its type in nav2_msgs
    goal: MakeGoal | None = None
    answer: Answer | None = None
    elapsed: str = ""  # the field of the result for the elapsed time


ACTIONS = (
    ActionRow("navigate_to_pose", "NavigateToPose", _to_pose),
    ActionRow("navigate_through_poses", "NavigateThroughPoses", _through_poses),
    ActionRow("follow_waypoints", "FollowWaypoints", _waypoints),
    ActionRow("follow_path", "FollowPath", _follow_path),
    ActionRow("spin", "Spin", _spin, elapsed="total_elapsed_time"),
    ActionRow("backup", "BackUp", partial(_straight, -1.0), elapsed="total_elapsed_time"),
    ActionRow(
        "drive_on_heading", "DriveOnHeading", partial(_straight, 1.0), elapsed="total_elapsed_time"
    ),
    ActionRow("wait", "Wait", _wait, elapsed="total_elapsed_time"),
    ActionRow("compute_path_to_pose", "ComputePathToPose", answer=_plan, elapsed="planning_time"),
    ActionRow(
        "compute_path_through_poses",
        "ComputePathThroughPoses",
        answer=_plan,
        elapsed="planning_time",
    ),
    ActionRow("smooth_path", "SmoothPath", answer=_smooth, elapsed="smoothing_duration"),
)


class _WithClock:
    """A node with its own clock, for some of the actions.

    rclpy's events executor warns about many timers on one clock, and each action has a timer.
    """

    def __init__(self, node: Node) -> None:
        self._node, self._clock = node, ROSClock()
        self._time = TimeSource(node=node)
        self._time.attach_clock(self._clock)

    def get_clock(self) -> ROSClock:
        """Return its clock."""
        return self._clock

    def __getattr__(self, name: str) -> Any:
        return getattr(self._node, name)


def offer_actions(node: Node, context: Context) -> "list[NavigationAction]":
    """Offer all actions."""
    nodes = [_WithClock(node) for _ in ACTIONS[::_TIMERS]]
    return [
        NavigationAction(node, nodes[number // _TIMERS], context, row)
        for number, row in enumerate(ACTIONS)
    ]


class NavigationAction:
    """One of the actions."""

    def __init__(self, node: Node, clocked: _WithClock, context: Context, row: ActionRow) -> None:
        """Offer the action, with the clock of ``clocked``."""
        self._node, self._context, self._row = node, context, row
        self._type = load_interface(f"nav2_msgs/action/{row.kind}")
        self._fields = self._type.Feedback.get_fields_and_field_types()
        self._prepared: Goal | RequestError | None = None
        self._action = DeferredAction(
            clocked,
            self._type,
            row.name,
            lambda goal: self._type.Result(),
            goal_callback=self._on_goal,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
            result_timeout=RESULT_KEPT,
        )

    @property
    def stops_on_failure(self) -> bool:
        """The parameter of that name."""
        return bool(self._node.get_parameter("stop_on_failure").value)

    def _on_goal(self, request: Any) -> GoalResponse:
        try:
            for name in _PLUGINS:
                value = getattr(request, name, "")
                if value not in _DEFAULT_PLUGINS:
                    raise OneBotError(f'there is no {name} "{value}": leave it empty')
            self._context.navigator()
            if self._row.goal is not None:
                self._context.prepare()
        except OneBotError as error:
            self._node.get_logger().error(f"{self._row.name}: goal rejected: {error}")
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _on_accepted(self, handle: Any) -> None:
        handle.execute()
        row, result = self._row, self._type.Result()
        try:
            if row.goal is None:
                assert row.answer is not None
                began = self._node.get_clock().now()
                row.answer(self._context, handle.request, result)
                setattr(result, row.elapsed, (self._node.get_clock().now() - began).to_msg())
                self._action.finish(handle, partial(_finished, "succeed", result))
                return
            goal = row.goal(self._context, self, handle.request)
            goal.handle = handle
            self._context.goals.start(goal)
        except (OneBotError, ValueError) as error:
            self._refuse(handle, result, error)

    def _refuse(self, handle: Any, result: Any, error: OneBotError | ValueError) -> None:
        self._node.get_logger().error(f"{self._row.name}: {error}")
        name = "TF_ERROR" if isinstance(error, OneBotError) else "INVALID_INPUT"
        if isinstance(error, NavigationError):
            name = error.failure.name
        elif isinstance(error, RequestError):
            name = error.code
        result.error_code, result.error_msg = self._code(name), str(error)
        self._action.finish(handle, partial(_finished, "abort", result))

    def _on_cancel(self, _: Any) -> CancelResponse:
        self._context.goals.cancel("the client cancelled it", self)
        return CancelResponse.ACCEPT

    def _code(self, name: str) -> int:
        """Return Nav2's code of an error, of this action or of the server that it would call."""
        several = self._row.kind == "NavigateThroughPoses"
        for kind in (self._row.kind, *(_CODES_OF_SEVERAL if several else _CODES)):
            result = load_interface(f"nav2_msgs/action/{kind}").Result
            if (value := getattr(result, name, None)) is not None:
                return int(value)
        return int(getattr(self._type.Result, "UNKNOWN", 0))

    def feed(self, goal: Goal, navigator: Navigator) -> None:
        """Send feedback."""
        feedback, remaining = self._type.Feedback(), navigator.distance_remaining
        elapsed = navigator.time - goal.began
        speed = max(goal.driven / elapsed if elapsed else 0.0, _EASY * navigator.vehicle.forward)
        values = {
            "current_pose": self._context.maps.pose_stamped(navigator.pose),
            "navigation_time": Duration(seconds=elapsed).to_msg(),
            "estimated_time_remaining": Duration(seconds=remaining / speed).to_msg(),
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
        for name in self._fields:
            setattr(feedback, name, values[name])
        goal.handle.publish_feedback(feedback)

    def ended(self, goal: Goal, reason: str, failure: Failure | None) -> None:
        """Send the result to the client."""
        handle, result = goal.handle, self._type.Result()
        if goal.missed:
            missed = load_interface("nav2_msgs/msg/MissedWaypoint")
            result.missed_waypoints = [
                missed(
                    index=index,
                    goal=self._context.maps.pose_stamped(goal.poses[index]),
                    error_code=self._code(waypoint.name),
                )
                for index, waypoint in goal.missed
            ]
        if self._row.elapsed:
            elapsed = self._context.navigator().time - goal.began
            setattr(result, self._row.elapsed, Duration(seconds=elapsed).to_msg())
        if reason and hasattr(result, "error_msg"):
            result.error_code = self._code(failure.name if failure else "UNKNOWN")
            result.error_msg = reason
        self._action.finish(handle, partial(_finished, "abort" if reason else "succeed", result))


def _finished(state: str, result: Any, handle: Any) -> Any:
    """Set the state of a goal, and return its result; it may have been cancelled meanwhile."""
    getattr(handle, "canceled" if handle.is_cancel_requested else state)()
    return result
