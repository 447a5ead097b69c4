"""The ROS interface of a joint_trajectory_controller: its topics, action and service."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from rclpy.duration import Duration
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from onebot_control.nodes.controller_node import (
    ControllerNode,
    ControllerPlace,
    GoalAction,
    GoalFunctions,
)
from onebot_control.trajectories.config import JointConstraint, JointGains, TrajectoryConfig
from onebot_control.trajectories.following import CANCELLED, Outcome, TrajectoryFollower
from onebot_control.trajectories.goal import TrajectoryGoal
from onebot_control.trajectories.tolerances import TolerancesGiven, tolerance_problems
from onebot_control.trajectories.trajectory import Waypoint
from onebot_description.errors import OneBotError, first_of
from onebot_description.parameters.reader import defaults
from onebot_description.ros.node_parameters import declare
from onebot_description.ros.topic_qos import DEPTH, make_qos
from onebot_description.ros.wire.cdr import nanoseconds
from onebot_description.ros.wire.interfaces import load_interface
from onebot_description.ros.wire.messages import time_message
from onebot_description.timing import NS_PER_S

# As joint_trajectory_controller's SystemDefaultsQoS with Fast DDS: the state is latched.
_LATCHED = make_qos(DEPTH, reliable=True, latched=True)

# As in joint_trajectory_controller with Fast DDS; only latched publishers match it.
_LATCHED_BY_ANY = make_qos(DEPTH, reliable=False, latched=True)


_Goal = tuple[TrajectoryGoal, TolerancesGiven | None]  # None for a goal from the topic


class JointTrajectories:
    """The ROS interface of a controller that moves joints along trajectories.

    ``onebot_control.joint_trajectory_controller`` lists its topics, action and service.
    """

    def __init__(self, place: ControllerPlace) -> None:
        """Offer topics, action, service and parameters."""
        node = place.node
        names = place.slot.robot.followers[place.controller.name].names
        single = _single(names)
        values = {**single, **place.controller.values}
        declared = declare(node, TrajectoryConfig, values, fixed={"joints": list(names)})
        self._host = host = ControllerNode[TrajectoryFollower](
            place, declared, partial(_own_values, place, single)
        )
        functions = GoalFunctions(
            goal=_action_goal,
            problems=self._problems,
            follow=self._follow,
            fill_feedback=lambda feedback: self._fill_state(
                feedback, feedback.desired, feedback.actual
            ),
            fill_result=_fill_result,
            accepted=self._report_tolerances,
        )
        kind = "control_msgs/action/FollowJointTrajectory"
        self._action = GoalAction(host, kind, "~/follow_joint_trajectory", functions)
        state = load_interface("control_msgs/msg/JointTrajectoryControllerState")
        query = load_interface("control_msgs/srv/QueryTrajectoryState")
        self._state = node.create_publisher(state, "~/controller_state", _LATCHED)
        self._message = state()
        place.publishers.append(self._publish)
        host.subscribe(JointTrajectory, "~/joint_trajectory", self._prepare)
        scaling = load_interface("control_msgs/msg/SpeedScalingFactor")
        topic = "~/speed_scaling_input"
        node.create_subscription(scaling, topic, self._on_scaling, _LATCHED_BY_ANY)
        node.create_service(query, "~/query_state", self._on_query)

    def _publish(self) -> None:
        """Publish ~/controller_state, if there are subscribers."""
        if not self._state.get_subscription_count():
            return
        follower, message = self._host.follower, self._message
        self._fill_state(message, message.reference, message.feedback)
        _fill(message.output, follower.reference(self._host.place.slot.robot.period))
        message.speed_scaling_factor = follower.scaling
        self._state.publish(message)

    def _fill_state(self, message: Any, desired: Any, measured: Any) -> None:
        """Fill the fields that ~/controller_state and the feedback have in common.

        As in joint_trajectory_controller, measured motion and error have the derivatives named in
        state_interfaces, and errors of derivatives are 0 while positions are commanded.
        """
        follower = self._host.follower
        message.header.stamp = time_message(self._host.place.stamp())
        message.joint_names = list(follower.names)
        _fill(desired, *follower.desired)
        state = follower.state
        _fill(measured, *state)
        _fill(message.error, follower.error, *([0.0] * len(values) for values in state[1:]))
        desired.time_from_start = Duration(seconds=follower.time).to_msg()
        measured.time_from_start = Duration(seconds=follower.elapsed).to_msg()

    # Goals -------------------------------------------------------------------------------------

    def _prepare(self, message: JointTrajectory) -> Callable[[], None] | None:
        follower, goal = self._host.follower, (_trajectory_goal(message), None)
        if fault := self._action.refusal(goal):
            self._ignore(fault)
            return None
        # No client waits for it: only the last trajectory of a cycle is followed.
        return lambda: self._start_streamed(follower, goal)

    def _start_streamed(self, follower: TrajectoryFollower, goal: _Goal) -> None:
        """Start following a trajectory of the topic; runs in the control thread."""
        try:
            self._action.start(follower, goal, None)
        except OneBotError as error:
            self._ignore(str(error))

    def _ignore(self, fault: str) -> None:
        self._host.error("topic", f"~/joint_trajectory is ignored: {fault}")

    def _report_tolerances(self, goal: _Goal) -> None:
        """Report tolerances that cannot be used; the follower uses the defaults."""
        if problems := tolerance_problems(goal[1] or TolerancesGiven(), self._host.follower.names):
            self._host.node.get_logger().error(first_of(problems))

    def _on_scaling(self, message: Any) -> None:
        def scale() -> None:
            self._host.follower.scaling = message.factor

        if fault := self._host.place.slot.fault(scale):
            self._host.error("scaling", f"~/speed_scaling_input is ignored: {fault}")

    def _problems(self, goal: _Goal) -> list[str]:
        loop = self._host.loop
        # Only the control thread may read the system time.
        now = loop.now_ns() if loop.simulated else self._host.place.stamp()
        return self._host.follower.problems(goal[0], now)

    def _follow(self, goal: _Goal, handle: Any) -> Outcome | None:
        trajectory, tolerances = goal
        return self._host.follower.start(trajectory, handle, tolerances)

    def _on_query(self, request: Any, answer: Any) -> Any:
        at = nanoseconds(request.time)
        follower = self._host.follower
        try:
            motion = self._host.loop.call(lambda: follower.query(at))
        except OneBotError as error:
            answer.message = str(error)
            return answer
        answer.success, answer.name = True, list(follower.names)
        answer.position, answer.velocity, answer.acceleration = map(list, motion)
        return answer


def _single(joints: Sequence[str]) -> dict[str, Any]:
    """Return the parameters of single joints, with their defaults."""
    return {
        f"{group}.{joint}.{name}": value
        for group, kind in (("constraints", JointConstraint), ("gains", JointGains))
        for joint in joints
        for name, value in defaults(kind).items()
    }


def _own_values(
    place: ControllerPlace, single: Mapping[str, Any], declared: Mapping[str, Any]
) -> dict[str, Any]:
    """Convert values of the declared parameters to those of the controller."""
    # Leave out defaults of single joints: another description may have other joints.
    values = {name: value for name, value in declared.items() if single.get(name) != value}
    return {**values, "joints": place.controller.config.joint_names}


def _action_goal(request: Any) -> _Goal:
    return _trajectory_goal(request.trajectory), _tolerances(request)


def _fill_result(result: Any, ended: Outcome) -> None:
    if ended.code != CANCELLED:
        result.error_code, result.error_string = ended.code, ended.text


def _trajectory_goal(message: JointTrajectory) -> TrajectoryGoal:
    points = [
        Waypoint(
            nanoseconds(point.time_from_start) / NS_PER_S,
            tuple(point.positions),
            tuple(point.velocities),
            tuple(point.accelerations),
        )
        for point in message.points
    ]
    return TrajectoryGoal(
        tuple(message.joint_names),
        tuple(points),
        nanoseconds(message.header.stamp),
        any(len(point.effort) for point in message.points),
    )


def _tolerances(request: Any) -> TolerancesGiven:
    path, goal = (
        {each.name: (each.position, each.velocity, each.acceleration) for each in tolerances}
        for tolerances in (request.path_tolerance, request.goal_tolerance)
    )
    return TolerancesGiven(path, goal, nanoseconds(request.goal_time_tolerance) / NS_PER_S)


def _fill(
    point: JointTrajectoryPoint,
    positions: Sequence[float],
    velocities: Sequence[float] = (),
    accelerations: Sequence[float] = (),
) -> None:
    point.positions, point.velocities = list(positions), list(velocities)
    point.accelerations = list(accelerations)
