"""joint_trajectory_controller's ROS interface: topics, action and service of one controller."""

from collections.abc import Callable, Sequence
from typing import Any

from rclpy.duration import Duration
from rclpy.parameter import Parameter
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from onebot_control.joint_controllers import TrajectoryController
from onebot_control.nodes.controller_node import Cancelled, GoalNode
from onebot_control.trajectories.config import (
    JointConstraint,
    JointGains,
    JointParameters,
    TrajectoryConfig,
    is_joint_parameter,
    joint_constraints,
)
from onebot_control.trajectories.following import Outcome, TrajectoryFollower
from onebot_control.trajectories.goal import TrajectoryGoal
from onebot_control.trajectories.tolerances import (
    ToleranceGiven,
    TolerancesGiven,
    tolerance_problems,
)
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

# As joint_trajectory_controller has it with Fast DDS; only latched publishers match it.
_LATCHED_BY_ANY = make_qos(DEPTH, reliable=False, latched=True)


_Goal = tuple[TrajectoryGoal, TolerancesGiven | None]  # None for a goal from the topic


class JointTrajectories(GoalNode[TrajectoryFollower, _Goal]):
    """The ROS interface of a controller that moves joints along trajectories.

    ``onebot_control.joint_trajectory_controller`` lists its topics, action and service.
    """

    action = "control_msgs/action/FollowJointTrajectory", "~/follow_joint_trajectory"

    def __init__(self, *arguments: Any) -> None:
        """Offer topics, action, service and parameters; see ``ControllerNode``."""
        super().__init__(*arguments)
        node, state = self.node, load_interface("control_msgs/msg/JointTrajectoryControllerState")
        query = load_interface("control_msgs/srv/QueryTrajectoryState")
        self._state = node.create_publisher(state, "~/controller_state", _LATCHED)
        self._message = state()
        self._subscribe(JointTrajectory, "~/joint_trajectory", self._prepare)
        scaling = load_interface("control_msgs/msg/SpeedScalingFactor")
        topic = "~/speed_scaling_input"
        node.create_subscription(scaling, topic, self._on_scaling, _LATCHED_BY_ANY)
        node.create_service(query, "~/query_state", self._on_query)

    def publish(self, stamp: int) -> None:
        """Publish ~/controller_state, if it is subscribed to."""
        super().publish(stamp)
        if not self._state.get_subscription_count():
            return
        arm, message = self._arm, self._message
        self._fill_state(message, message.reference, message.feedback)
        _fill(message.output, arm.reference(self._robot().period))
        message.speed_scaling_factor = arm.scaling
        self._state.publish(message)

    def _fill_state(self, message: Any, desired: Any, measured: Any) -> None:
        """Fill the fields that ~/controller_state and the feedback have in common.

        As joint_trajectory_controller's, measured motion and error have the derivatives that
        state_interfaces name, and errors of derivatives are 0 while positions are commanded.
        """
        arm = self._arm
        message.header.stamp = time_message(self._stamp)
        message.joint_names = list(arm.names)
        _fill(desired, *arm.desired)
        state = arm.state
        _fill(measured, *state)
        _fill(message.error, arm.error, *([0.0] * len(values) for values in state[1:]))
        desired.time_from_start = Duration(seconds=arm.time).to_msg()
        measured.time_from_start = Duration(seconds=arm.elapsed).to_msg()

    # Goals -------------------------------------------------------------------------------------

    def _prepare(self, message: JointTrajectory) -> Callable[[], None] | None:
        arm, goal = self._arm, (_trajectory_goal(message), None)
        if fault := self._refusal(goal):
            self._ignore(fault)
            return None
        # Nobody waits for it: of what a cycle receives, the last trajectory is followed.
        return lambda: self._start_streamed(arm, goal)

    def _start_streamed(self, arm: TrajectoryFollower, goal: _Goal) -> None:
        """Start following a trajectory of the topic; runs in the control thread."""
        try:
            self._start(arm, goal, None)
        except OneBotError as error:
            self._ignore(str(error))

    def _ignore(self, fault: str) -> None:
        self._error("topic", f"~/joint_trajectory is ignored: {fault}")

    def _on_accepted(self, handle: Any) -> None:
        arm, (trajectory, tolerances) = self._accepted
        if problems := tolerance_problems(tolerances or TolerancesGiven(), arm.names):
            self.node.get_logger().error(first_of(problems))
            self._accepted = arm, (trajectory, None)  # the defaults
        super()._on_accepted(handle)

    def _on_scaling(self, message: Any) -> None:
        def scale() -> None:
            self._arm.scaling = message.factor

        if fault := self._fault(scale):
            self._error("scaling", f"~/speed_scaling_input is ignored: {fault}")

    def _goal(self, request: Any) -> _Goal:
        return _trajectory_goal(request.trajectory), _tolerances(request)

    def _problems(self, goal: _Goal) -> list[str]:
        loop = self._loop
        # Only the control thread may ask for the system's time.
        now = loop.now_ns() if loop.simulated else self._stamp
        return self._arm.problems(goal[0], now)

    def _follow(self, goal: _Goal, handle: Any) -> Outcome | None:
        trajectory, tolerances = goal
        return self._arm.start(trajectory, handle, tolerances)

    def _feedback(self) -> Any:
        feedback = self._type.Feedback()
        self._fill_state(feedback, feedback.desired, feedback.actual)
        return feedback

    def _result(self, ended: Outcome | Cancelled) -> Any:
        if isinstance(ended, Cancelled):
            return self._type.Result()
        return self._type.Result(error_code=ended.code, error_string=ended.text)

    def _on_query(self, request: Any, answer: Any) -> Any:
        at = nanoseconds(request.time)
        arm = self._arm
        try:
            motion = self._loop.call(lambda: arm.query(at))
        except OneBotError as error:
            answer.message = str(error)
            return answer
        answer.success, answer.name = True, list(arm.names)
        answer.position, answer.velocity, answer.acceleration = map(list, motion)
        return answer

    # Parameters --------------------------------------------------------------------------------

    def _declare(self) -> dict[str, Any]:
        names, values = self._arm.names, dict(self._controller.values)
        common = {n: v for n, v in values.items() if not is_joint_parameter(n)}
        single = {
            f"{group}.{joint}.{name}": value
            for group, kind in (("constraints", JointConstraint), ("gains", JointGains))
            for joint in names
            for name, value in defaults(kind).items()
        }
        single_values = {n: v for n, v in values.items() if n in single}
        return {
            **declare(self.node, TrajectoryConfig, common, fixed={"joints": list(names)}),
            **declare(self.node, JointParameters, single, single_values),
        }

    def _configured(self, parameters: Sequence[Parameter] = ()) -> TrajectoryController:
        joints = self._controller.joints
        values = {**self._values, **self._changed(parameters), "joints": joints}
        # Leave out defaults of single joints: another description may have other joints.
        values = {n: v for n, v in values.items() if v or not is_joint_parameter(n)}
        joint_constraints(values, self._arm.names)
        return TrajectoryController(self._controller.name, values)


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
        tuple([ToleranceGiven(t.name, t.position, t.velocity, t.acceleration) for t in tolerances])
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
