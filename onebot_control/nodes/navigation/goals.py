"""The navigator's actions and its topic goal_pose: one goal at a time drives the robot."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseStamped
from rclpy.action import CancelResponse, GoalResponse
from rclpy.duration import Duration
from rclpy.node import Node

from onebot_control.navigation.navigator import Failure, Navigator
from onebot_control.nodes.controller_node import RESULT_KEPT, DeferredAction
from onebot_control.nodes.navigation.maps import pose_message
from onebot_description.errors import OneBotError
from onebot_description.geometry.poses import PlanarPose
from onebot_description.ros.topic_qos import DEPTH
from onebot_description.ros.wire.interfaces import load_interface

_PASSED = 0.5  # m from a pose of navigate_through_poses at which the next one counts
_MONITORED = 0.1  # s between two feedbacks
_CODES = "nav2_msgs/action/ComputePathToPose", "nav2_msgs/action/FollowPath"


@dataclass
class Goal:
    """A goal that drives the robot.

    Attributes:
        handle: of the action; None for a goal of the topic.
        action: the action that it came by; None for the topic.
        poses: in the map, those to come.
        kind: whether each pose is reached ("waypoints"), or only the last one ("through").
        count: number of all poses.
        missed: failures of waypoints.
        loops: how often the waypoints are driven again.
    """

    handle: Any
    action: "NavigationAction | None"
    poses: list[PlanarPose]
    kind: str = "through"
    missed: list[Any] = field(default_factory=list)
    loops: int = 0
    began: float = 0.0
    length: float = 0.0  # m driven
    last: PlanarPose | None = None

    def __post_init__(self) -> None:
        """Remember all poses."""
        self.all = tuple(self.poses)


class Goals:
    """Starts goals, watches over them, and tells their clients how they end."""

    def __init__(
        self,
        node: Node,
        navigator: Callable[[], Navigator],
        to_map: Callable[[PoseStamped], PlanarPose],
        begin: Callable[[], None],
        frame: str,
    ) -> None:
        """Offer actions and topic.

        Args:
            node: the navigator's node.
            navigator: returns the navigator; raises OneBotError while there is none.
            to_map: returns a pose in the map; raises OneBotError.
            begin: called before a goal drives the robot; raises OneBotError if it cannot.
            frame: the map's.
        """
        self._frame = frame
        self._node, self._navigator, self._to_map, self._begin = node, navigator, to_map, begin
        self._goal: Goal | None = None
        node.create_subscription(PoseStamped, "goal_pose", self._on_pose, DEPTH)
        self._actions = [
            NavigationAction(self, node, name, kind, poses)
            for name, kind, poses in (
                ("navigate_to_pose", "NavigateToPose", lambda goal: [goal.pose]),
                ("navigate_through_poses", "NavigateThroughPoses", lambda goal: goal.poses),
                ("follow_waypoints", "FollowWaypoints", lambda goal: goal.poses),
            )
        ]
        self._fed = -math.inf

    def pose_message(self, pose: PlanarPose) -> PoseStamped:
        """Return a pose of the map as a message, stamped now."""
        message = PoseStamped()
        message.header.frame_id = self._frame
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.pose = pose_message(pose)
        return message

    @property
    def active(self) -> bool:
        """Whether a goal drives the robot."""
        return self._goal is not None

    def _on_pose(self, message: PoseStamped) -> None:
        try:
            self.start(Goal(None, None, [self._to_map(message)]))
        except OneBotError as error:
            self._node.get_logger().error(f"goal_pose is refused: {error}")

    def prepared(self, request: Any, poses: Sequence[PoseStamped]) -> list[PlanarPose]:
        """Return the poses of a request in the map.

        Raises:
            OneBotError: it cannot be done, or not now.
        """
        if not poses:
            raise OneBotError("it has no pose")
        if getattr(request, "behavior_tree", ""):
            raise OneBotError("there are no behavior trees here: leave behavior_tree empty")
        self._begin()
        return [self._to_map(pose) for pose in poses]

    def start(self, goal: Goal) -> None:
        """Drive to a goal, in place of any other.

        Raises:
            OneBotError: it cannot be done now.
        """
        self._begin()
        navigator = self._navigator()
        self._end("another goal has come")
        self._goal = goal
        goal.began, goal.last = navigator.time, navigator.pose
        self._next(navigator)

    def _next(self, navigator: Navigator) -> None:
        assert self._goal is not None
        pose = self._goal.poses[0]
        navigator.go_to(pose.x, pose.y, pose.yaw)
        self._log(f"driving to {pose.x:.2f}, {pose.y:.2f} m, {pose.yaw:.2f} rad")

    def cancel(self, reason: str) -> None:
        """End the goal, if there is one."""
        if self._goal is not None:
            self._end(reason)

    def step(self) -> None:
        """Look at how the goal stands; call this after each update of the navigator."""
        goal, navigator = self._goal, self._navigator()
        if goal is None:
            return
        if goal.last is not None:
            moved = navigator.pose.x - goal.last.x, navigator.pose.y - goal.last.y
            goal.length += math.hypot(*moved)
        goal.last = navigator.pose
        if not navigator.navigating:
            self._leg_ended(goal, navigator)
        elif goal.kind == "through" and len(goal.poses) > 1:
            away = goal.poses[0].x - goal.last.x, goal.poses[0].y - goal.last.y
            if math.hypot(*away) < _PASSED:
                goal.poses.pop(0)
                self._next(navigator)
        if self._goal is goal and navigator.time - self._fed >= _MONITORED:
            self._fed = navigator.time
            if goal.action is not None:
                goal.action.feed(goal, navigator)

    def _leg_ended(self, goal: Goal, navigator: Navigator) -> None:
        arrived = navigator.status == "arrived"
        if goal.kind == "waypoints" and not arrived and navigator.failure is not None:
            self._log(f"a waypoint is missed: {navigator.reason}")
            goal.missed.append((len(goal.all) - len(goal.poses), navigator.failure))
        elif not arrived:
            self._end(navigator.reason, navigator.failure)
            return
        goal.poses.pop(0)
        if not goal.poses and goal.loops > 0:
            goal.loops -= 1
            goal.poses = list(goal.all)
        if goal.poses:
            self._next(navigator)
        else:
            self._end("")

    def _end(self, reason: str, failure: Failure | None = None) -> None:
        """End the goal: reached without a reason, failed with a failure, cancelled otherwise."""
        goal, self._goal = self._goal, None
        if goal is None:
            return
        navigator = self._navigator()
        navigator.cancel(reason)
        self._log(f"the goal has ended: {reason}" if reason else "the goal is reached")
        if goal.action is not None:
            goal.action.end(goal, reason, failure)

    def _log(self, text: str) -> None:
        self._node.get_logger().info(text)


class NavigationAction:
    """One of the actions that drive to poses."""

    def __init__(
        self,
        goals: Goals,
        node: Node,
        name: str,
        kind: str,
        poses: Callable[[Any], Sequence[PoseStamped]],
    ) -> None:
        """Offer the action.

        Args:
            goals: takes its goals.
            node: the node.
            name: name of the action.
            kind: its type in nav2_msgs.
            poses: returns the poses of a request.
        """
        self._goals, self._node, self._name, self._poses = goals, node, name, poses
        self._type = load_interface(f"nav2_msgs/action/{kind}")
        self._prepared: list[PlanarPose] = []
        self._action = DeferredAction(
            node,
            self._type,
            name,
            lambda goal: self._type.Result(),
            goal_callback=self._on_goal,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
            result_timeout=RESULT_KEPT,
        )
        self._fields = self._type.Feedback.get_fields_and_field_types()

    def _on_goal(self, request: Any) -> GoalResponse:
        try:
            self._prepared = self._goals.prepared(request, self._poses(request))
        except OneBotError as error:
            self._node.get_logger().error(f"{self._name}: goal rejected: {error}")
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _on_accepted(self, handle: Any) -> None:
        handle.execute()
        request = handle.request
        kind = "waypoints" if self._name == "follow_waypoints" else "through"
        goal = Goal(handle, self, self._prepared, kind)  # rclpy calls this right after ``_on_goal``
        goal.loops = int(getattr(request, "number_of_loops", 0))
        goal.poses = goal.poses[int(getattr(request, "goal_index", 0)) :] or goal.poses
        try:
            self._goals.start(goal)
        except OneBotError as error:
            self.end(goal, str(error), None)

    def _on_cancel(self, handle: Any) -> CancelResponse:
        if self._goals.active:
            self._goals.cancel("the client has cancelled it")
        return CancelResponse.ACCEPT

    def feed(self, goal: Goal, navigator: Navigator) -> None:
        """Send feedback."""
        feedback, remaining = self._type.Feedback(), navigator.distance_remaining
        elapsed = navigator.time - goal.began
        mean = goal.length / elapsed if elapsed > 0.0 else 0.0
        speed = max(mean, 0.3 * navigator.vehicle.forward)
        values = {
            "current_pose": None,
            "navigation_time": Duration(seconds=elapsed).to_msg(),
            "estimated_time_remaining": Duration(seconds=remaining / speed).to_msg(),
            "number_of_recoveries": navigator.recoveries,
            "distance_remaining": remaining,
            "number_of_poses_remaining": len(goal.poses),
            "current_waypoint": len(goal.all) - len(goal.poses),
        }
        if "current_pose" in self._fields:
            values["current_pose"] = self._goals.pose_message(navigator.pose)
        for name, value in values.items():
            if name in self._fields:
                setattr(feedback, name, value)
        goal.handle.publish_feedback(feedback)

    def end(self, goal: Goal, reason: str, failure: Failure | None) -> None:
        """Send the client the result."""
        result = self._type.Result()
        if hasattr(result, "missed_waypoints"):
            kind = load_interface("nav2_msgs/msg/MissedWaypoint")
            result.missed_waypoints = [
                kind(
                    index=index,
                    goal=self._goals.pose_message(goal.all[index]),
                    error_code=code(why),
                )
                for index, why in goal.missed
            ]
        elif failure is not None:
            result.error_code, result.error_msg = code(failure), reason
        state = "abort" if reason else "succeed"
        if goal.handle.is_cancel_requested:
            state = "canceled"
        self._action.finish(goal.handle, partial(_ended, state, result))


def _ended(state: str, result: Any, handle: Any) -> Any:
    getattr(handle, state)()
    return result


def code(failure: Failure) -> int:
    """Return Nav2's error code of a failure."""
    for kind in _CODES:
        value = getattr(load_interface(kind).Result, failure.name, None)
        if value is not None:
            return int(value)
    return 0
