"""joint_trajectory_controller's ROS interface: topics, action and service of one controller."""

from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

from rcl_interfaces.msg import SetParametersResult
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.clock import Clock
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from onebot_control.driven_robot import DrivenRobot, JointController
from onebot_control.nodes.control_loop import ControlLoop
from onebot_control.trajectories.config import (
    JointParameters,
    TrajectoryConfig,
    is_joint_parameter,
)
from onebot_control.trajectories.following import SUCCESSFUL, Outcome, TrajectoryFollower
from onebot_control.trajectories.goal import TrajectoryGoal
from onebot_control.trajectories.tolerances import (
    ToleranceGiven,
    TolerancesGiven,
    tolerance_problems,
)
from onebot_control.trajectories.trajectory import Waypoint
from onebot_description.errors import OneBotError
from onebot_description.ros.node import Throttled
from onebot_description.ros.parameters.reader import declare, refuse_undeclared
from onebot_description.ros.parameters.values import plain
from onebot_description.ros.wire.cdr import NANO, nanoseconds
from onebot_description.ros.wire.interfaces import load_interface
from onebot_description.ros.wire.messages import time_message

# As SystemDefaultsQoS is with Fast DDS: a subscription takes any publisher, the state is latched.
_ANY = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
_LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_MOST_PROBLEMS = 5  # logged of one goal


class _Action(ActionServer):
    """An action whose goals the control loop executes."""

    def notify_execute(self, goal_handle: Any, execute_callback: Any) -> None:
        """Do nothing: the goal is followed already."""

    def finish(self, goal_handle: Any, end: Callable[[Any], Any]) -> None:
        """Have ``end`` set the state of a goal, and return its result, soon."""
        super().notify_execute(goal_handle, end)


class _Cancelled(NamedTuple):
    """A goal that its client has cancelled."""

    goal: Any


class JointTrajectories:
    """The ROS interface of a controller that moves joints by trajectories.

    Its callbacks run in the thread that spins the node; what they change of the robot, they change
    in the control thread. ``publish`` and ``finish`` are called there.

    Attributes:
        node: of the controller.
    """

    def __init__(
        self,
        node: Node,
        controller: JointController,
        robot: Callable[[], DrivenRobot],
        loop: ControlLoop,
        refused: Callable[[], str],
        clock: Clock,
    ) -> None:
        """Offer topics, action, service and parameters.

        Args:
            node: of the controller's name.
            controller: with the parameters of the files.
            robot: returns the robot.
            loop: calls what changes the robot.
            refused: why no goal is accepted now; "" if they are.
            clock: of the feedback's timer.
        """
        self.node, self._controller, self._robot, self._loop = node, controller, robot, loop
        self._refused = refused
        self._warn = Throttled(node.get_logger().warning)
        self._ended: deque[Outcome | _Cancelled] = deque()
        self._type = load_interface("control_msgs/action/FollowJointTrajectory")
        state = load_interface("control_msgs/msg/JointTrajectoryControllerState")
        query = load_interface("control_msgs/srv/QueryTrajectoryState")
        self._state = node.create_publisher(state, "~/controller_state", _LATCHED)
        self._message = state()
        node.create_subscription(JointTrajectory, "~/joint_trajectory", self._on_topic, _ANY)
        node.create_service(query, "~/query_state", self._on_query)
        self._declare()
        self._action = _Action(
            node,
            self._type,
            "~/follow_joint_trajectory",
            lambda goal: self._type.Result(),
            goal_callback=self._on_goal,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
        )
        self._active: Any = None  # the handle of the goal that is followed
        node.create_timer(1.0 / controller.config.action_monitor_rate, self._monitor, clock=clock)

    @property
    def _arm(self) -> TrajectoryFollower:
        return self._robot().arms[self._controller.name]

    # In the control thread ---------------------------------------------------------------------

    def publish(self, stamp: int) -> None:
        """Publish ~/controller_state, if it is subscribed to."""
        if not self._state.get_subscription_count():
            return
        arm, message = self._arm, self._message
        message.header.stamp = time_message(stamp)
        message.joint_names = list(arm.names)
        _fill(message.reference, *arm.desired)
        _fill(message.feedback, arm.measured.positions, arm.measured.velocities)
        _fill(message.error, arm.error)
        _fill(message.output, arm.reference(0.0))
        message.speed_scaling_factor = arm.scaling
        self._state.publish(message)

    def finish(self, outcome: Outcome) -> None:
        """Note how a goal ended; its client is sent it soon."""
        self._ended.append(outcome)

    # Goals -------------------------------------------------------------------------------------

    def _on_topic(self, message: JointTrajectory) -> None:
        self._call(lambda: self._start(_goal(message)), "~/joint_trajectory is ignored")

    def _on_goal(self, request: Any) -> GoalResponse:
        goal = _goal(request.trajectory)
        accepted = self._call(lambda: self._check(goal), "goal rejected")
        return GoalResponse.ACCEPT if accepted else GoalResponse.REJECT

    def _on_accepted(self, handle: Any) -> None:
        goal, tolerances = _goal(handle.request.trajectory), _tolerances(handle.request)
        for problem in tolerance_problems(tolerances, self._arm.names)[:_MOST_PROBLEMS]:
            self.node.get_logger().error(problem)
        handle.execute()
        self._active = handle
        if not self._call(lambda: self._start(goal, handle, tolerances), "goal aborted"):
            self._ended.append(Outcome(handle, -1, "the goal can no longer be followed"))

    def _on_cancel(self, handle: Any) -> CancelResponse:
        if not self._call(lambda: self._cancel(handle), "not cancelled"):
            return CancelResponse.REJECT
        self._ended.append(_Cancelled(handle))
        return CancelResponse.ACCEPT

    def _call(self, action: Callable[[], object], fault: str) -> bool:
        """Do something in the control thread; return whether that succeeded."""
        try:
            self._loop.call(action)
        except OneBotError as error:
            for line in str(error).splitlines()[:_MOST_PROBLEMS]:
                self.node.get_logger().error(f"{fault}: {line}")
            return False
        return True

    def _check(self, goal: TrajectoryGoal) -> None:
        """Raise OneBotError if a goal cannot be followed now."""
        if refused := self._refused():
            raise OneBotError(refused)
        if problems := self._arm.problems(goal, self._loop.now_ns()):
            raise OneBotError("\n".join(problems))

    def _start(
        self,
        goal: TrajectoryGoal,
        handle: Any = None,
        tolerances: TolerancesGiven | None = None,
    ) -> None:
        self._check(goal)
        if preempted := self._arm.start(goal, handle, tolerances):
            self.finish(preempted)

    def _cancel(self, handle: Any) -> None:
        if self._arm.active is not handle:
            raise OneBotError("the goal has ended")
        self._arm.cancel()

    # Feedback and results ----------------------------------------------------------------------

    def _monitor(self) -> None:
        """Send feedback, and the results of what has ended."""
        while self._ended:
            self._end(self._ended.popleft())
        if (handle := self._active) is not None:
            arm, feedback = self._arm, self._type.Feedback()
            feedback.header.stamp = self.node.get_clock().now().to_msg()
            feedback.joint_names = list(arm.names)
            _fill(feedback.desired, *arm.desired)
            _fill(feedback.actual, arm.measured.positions, arm.measured.velocities)
            _fill(feedback.error, arm.error)
            handle.publish_feedback(feedback)

    def _end(self, ended: Outcome | _Cancelled) -> None:
        if isinstance(ended, Outcome):
            text = f"{ended.text}: {ended.detail}" if ended.detail else ended.text
            log = self.node.get_logger()
            (log.info if ended.code == SUCCESSFUL else log.warning)(text)
        if ended.goal is None:
            return
        if ended.goal == self._active:
            self._active = None
        self._action.finish(ended.goal, partial(self._result, ended))

    def _result(self, ended: Outcome | _Cancelled, handle: Any) -> Any:
        result = self._type.Result()
        if isinstance(ended, _Cancelled):
            handle.canceled()
        else:
            (handle.succeed if ended.code == SUCCESSFUL else handle.abort)()
            result.error_code, result.error_string = ended.code, ended.text
        return result

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

    def _declare(self) -> None:
        names, values = self._arm.names, dict(self._controller.values)
        common = {n: v for n, v in values.items() if not is_joint_parameter(n)}
        single = {f"constraints.{joint}.{tolerance}": 0.0 for joint in names for tolerance in _OWN}
        single |= {n: v for n, v in values.items() if n in single}
        self._values = {
            **declare(self.node, TrajectoryConfig, {**common, "joints": list(names)}),
            **declare(self.node, JointParameters, single),
        }
        refuse_undeclared(self.node, TrajectoryConfig)
        self.node.add_on_set_parameters_callback(self._validate)
        self.node.add_post_set_parameters_callback(self._apply)

    def _validate(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        try:
            self._configured(parameters)
        except OneBotError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply(self, parameters: Sequence[Parameter]) -> None:
        self._controller = controller = self._configured(parameters)
        self._values = dict(controller.values)
        self._loop.call(lambda: self._robot().configure_arm(controller))

    def _configured(self, parameters: Sequence[Parameter]) -> JointController:
        changed = {p.name: plain(p.value) for p in parameters if p.name in self._values}
        return JointController.read(
            self._controller.name, {**self._values, **changed}, self._arm.names
        )


_OWN = ("trajectory", "goal", "max_deceleration_on_cancel")


def _goal(message: JointTrajectory) -> TrajectoryGoal:
    points = [
        Waypoint(
            nanoseconds(point.time_from_start) / NANO,
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
        tuple([ToleranceGiven(t.name, t.position, t.velocity, t.acceleration) for t in given])
        for given in (request.path_tolerance, request.goal_tolerance)
    )
    return TolerancesGiven(path, goal, nanoseconds(request.goal_time_tolerance) / NANO)


def _fill(
    point: JointTrajectoryPoint,
    positions: Sequence[float],
    velocities: Sequence[float] = (),
    accelerations: Sequence[float] = (),
) -> None:
    point.positions, point.velocities = list(positions), list(velocities)
    point.accelerations = list(accelerations)
