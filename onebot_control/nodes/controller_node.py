"""The common base of the ROS interfaces of joint controllers: parameters and goals.

Everything that changes the robot is called in the control thread, between two cycles.
"""

import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any, Generic, NamedTuple, Protocol, TypeVar, cast

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.clock import Clock
from rclpy.node import Node
from rclpy.parameter import Parameter

from onebot_control.controlled_robot import ControlledRobot
from onebot_control.joint_controllers import JointController, JointFollower, named
from onebot_control.runtime.control_loop import ControlLoop
from onebot_control.trajectories.following import INVALID_GOAL, SUCCESSFUL, Outcome
from onebot_description.errors import OneBotError, first_of
from onebot_description.parameters.values import plain
from onebot_description.ros.message_age import Delivery, SenderClock
from onebot_description.ros.node_parameters import declare, follow_changes, refuse_undeclared
from onebot_description.ros.topic_qos import ANY_PUBLISHER
from onebot_description.ros.wire.interfaces import load_interface
from onebot_description.timing.throttled import Throttled
from onebot_description.timing.wake_detector import boot_time

_IGNORED_EVERY = 1.0  # s between two log messages about ignored messages
_OLD = "it may be from before this process woke from a stop; send it again"
# Seconds that a result is kept for its client, as in rclcpp; rclpy's default is 900. It is not a
# whole number of cycles: rcl's timer fires after exactly this time, but a result expires only
# later. While simulated time stands at that moment, an executor would find the timer ready forever.
_RESULT_KEPT = 10.0000005


class GoalFollower(JointFollower, Protocol):
    """A JointFollower that moves joints to the goals of an action.

    Attributes:
        active: the handle of the goal; None if there is none.
    """

    active: Any

    def cancel(self) -> None:
        """Cancel the goal, and stop."""


F = TypeVar("F", bound=JointFollower)
A = TypeVar("A", bound=GoalFollower)
G = TypeVar("G")  # a goal, as the follower takes it


class ControllerNode(Generic[F]):
    """The ROS interface of one joint controller.

    Its callbacks run in the thread that spins the node, and change the robot in the control thread
    only. ``publish`` and ``finish`` are called in the control thread.

    Attributes:
        node: the controller's node.
    """

    def __init__(
        self,
        node: Node,
        controller: JointController[F],
        robot: Callable[[], ControlledRobot],
        loop: ControlLoop,
        refused: Callable[[], str],
        clock: Clock,
    ) -> None:
        """Declare the parameters; subclasses add topics, actions and services.

        Args:
            node: the node, with the controller's name.
            controller: controller with the parameters of the files.
            robot: returns the current robot.
            loop: the control loop, which calls everything that changes the robot.
            refused: returns why commands are refused now; "" if they are not.
            clock: clock of the timers.
        """
        self.node, self._controller, self._robot, self._loop = node, controller, robot, loop
        self._refused, self._clock = refused, clock
        self._error = Throttled(lambda text: node.get_logger().error(text), _IGNORED_EVERY)
        self._stamp = 0  # the last cycle's, ns
        self._values = self._declare()
        with named(controller.name):
            self._controller = self._configured()  # first configuration: the command line's
        self._robot().configure_arm(self._controller)
        refuse_undeclared(self.node, controller.parameters)
        follow_changes(node, self._configured, self._apply)

    @property
    def _arm(self) -> F:
        return cast(F, self._robot().arms[self._controller.name])

    def publish(self, stamp: int) -> None:
        """Publish the state in a control cycle of a ``stamp``, ns."""
        self._stamp = stamp

    def finish(self, outcome: Outcome) -> None:
        """Take notice of how a goal ended."""

    def _subscribe(
        self, kind: Any, topic: str, prepare: Callable[[Any], Callable[[], None] | None]
    ) -> None:
        """Subscribe to commands; those sent before the process woke from a stop are ignored.

        Args:
            kind: type of the messages.
            topic: name of the topic.
            prepare: called with each message; returns what to call in the control thread.
        """
        sender = SenderClock()

        def receive(message: Any, info: Mapping[str, Any]) -> None:
            sent = boot_time() - sender.age(Delivery.from_info(info), time.time_ns()).most
            if (act := prepare(message)) is not None:
                self._loop.post(lambda: act_on(sent, act))

        def act_on(sent: float, act: Callable[[], None]) -> None:
            if self._loop.predates_wake(sent):
                self._error("old", f"{topic} is ignored: {_OLD}")
            else:
                act()

        self.node.create_subscription(kind, topic, receive, ANY_PUBLISHER)

    def _fault(self, action: Callable[[], object]) -> str:
        """Run ``action`` in the control thread; return why it failed, or ""."""
        try:
            self._loop.call(action)
        except OneBotError as error:
            return str(error)
        return ""

    # Parameters --------------------------------------------------------------------------------

    def _declare(self) -> dict[str, Any]:
        """Declare the parameters; return the values in force."""
        controller = self._controller
        return declare(self.node, controller.parameters, fixed=controller.values)

    def _apply(self, parameters: Sequence[Parameter]) -> None:
        self._values.update(self._changed(parameters))
        self._controller = controller = self._configured()
        if fault := self._fault(lambda: self._robot().configure_arm(controller)):
            self.node.get_logger().error(f"parameters not applied: {fault}")

    def _changed(self, parameters: Sequence[Parameter]) -> dict[str, Any]:
        return {p.name: plain(p.value) for p in parameters if p.name in self._values}

    def _configured(self, parameters: Sequence[Parameter] = ()) -> JointController[F]:
        """Return the controller with the values in force, and ``parameters`` set."""
        values = {**self._values, **self._changed(parameters)}
        return type(self._controller)(self._controller.name, values)


class _Action(ActionServer):
    """An action whose goals the control loop executes."""

    def notify_execute(self, goal_handle: Any, execute_callback: Any) -> None:
        """Do nothing: the goal is followed already."""

    def finish(self, goal_handle: Any, end: Callable[[Any], Any]) -> None:
        """End a goal soon: ``end`` sets its state and returns its result."""
        super().notify_execute(goal_handle, end)


class Cancelled(NamedTuple):
    """A goal that its client has cancelled."""

    goal: Any


class GoalNode(ControllerNode[A], ABC, Generic[A, G]):
    """The ROS interface of a controller whose joints are moved by the goals of an action."""

    action: tuple[str, str]  # its type and name

    def __init__(self, *arguments: Any) -> None:
        """Offer the action, too; ``arguments`` are those of ControllerNode."""
        super().__init__(*arguments)
        kind, name = self.action
        self._type = load_interface(kind)
        self._ended: deque[tuple[Outcome | Cancelled, Any]] = deque()  # each with its result
        self._arm.active = None  # an earlier node's goal has no client any more
        self._action = _Action(
            self.node,
            self._type,
            name,
            lambda goal: self._type.Result(),
            goal_callback=self._on_goal,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
            result_timeout=_RESULT_KEPT,
        )
        rate = self._controller.config.action_monitor_rate
        self.node.create_timer(1.0 / rate, self._monitor, clock=self._clock)

    # Goals of a kind ---------------------------------------------------------------------------

    @abstractmethod
    def _goal(self, request: Any) -> G:
        """Convert a request to a goal for the follower; it may take long."""

    @abstractmethod
    def _problems(self, goal: G) -> list[str]:
        """Return why a goal is refused, a line for each reason; it may take long."""

    @abstractmethod
    def _follow(self, goal: G, handle: Any) -> Outcome | None:
        """Follow a goal; return the outcome of the goal it preempts. Runs in the control thread."""

    @abstractmethod
    def _feedback(self) -> Any:
        """Return the feedback message. Runs in the control thread."""

    @abstractmethod
    def _result(self, ended: Outcome | Cancelled) -> Any:
        """Return the result of a goal that has just ended. Runs in the control thread."""

    # In the control thread ---------------------------------------------------------------------

    def finish(self, outcome: Outcome | Cancelled) -> None:
        """Take notice of how a goal ended; its client gets the result soon."""
        self._ended.append((outcome, self._result(outcome)))

    def _start(self, arm: A, goal: G, handle: Any) -> None:
        """Follow a goal that was checked for ``arm``."""
        if arm is not self._arm:
            raise OneBotError("the robot was reset, or its description changed, just now")
        if refused := self._refused():
            raise OneBotError(refused)
        if preempted := self._follow(goal, handle):
            self.finish(preempted)

    def _cancel(self, handle: Any) -> None:
        """Cancel a goal, unless it has just ended: then its client gets that result."""
        if self._arm.active is handle:
            self._arm.cancel()
            self.finish(Cancelled(handle))

    # Goals -------------------------------------------------------------------------------------

    # Goals are checked in the node's thread: many points take longer than a control cycle.

    def _refusal(self, goal: G) -> str:
        """Return why a goal cannot be followed now; "" if it can."""
        return self._refused() or first_of([*self._problems(goal)])

    # The action --------------------------------------------------------------------------------

    def _on_goal(self, request: Any) -> GoalResponse:
        arm, goal = self._arm, self._goal(request)
        if fault := _OLD if self._loop.just_woke else self._refusal(goal):
            self.node.get_logger().error(f"goal rejected: {fault}")
            return GoalResponse.REJECT
        self._accepted = arm, goal
        return GoalResponse.ACCEPT

    def _on_accepted(self, handle: Any) -> None:
        arm, goal = self._accepted  # rclpy calls this at once after ``_on_goal``
        handle.execute()
        if fault := self._fault(lambda: self._start(arm, goal, handle)):
            self.finish(Outcome(handle, INVALID_GOAL, fault))

    def _on_cancel(self, handle: Any) -> CancelResponse:
        """Cancel a goal, and always accept.

        When a client cancels all goals, rclpy skips the goal after a refused one. A goal that has
        just ended keeps its own result.
        """
        if fault := self._fault(lambda: self._cancel(handle)):
            self.node.get_logger().error(f"goal not stopped: {fault}")
        return CancelResponse.ACCEPT

    def _monitor(self) -> None:
        """Send feedback, and the results of goals that have ended."""
        # The client's next goal must not come while goals are refused because of that wake.
        while self._ended and not self._loop.just_woke:
            self._end(*self._ended.popleft())
        if (handle := self._arm.active) is not None:
            with suppress(OneBotError):  # the loop has just ended
                handle.publish_feedback(self._loop.call(self._feedback))

    def _end(self, ended: Outcome | Cancelled, result: Any) -> None:
        if isinstance(ended, Outcome):
            self._log(ended)
        if ended.goal is None:
            return
        self._action.finish(ended.goal, partial(_ended_handle, ended, result))

    def _log(self, outcome: Outcome) -> None:
        text = f"{outcome.text}: {outcome.detail}" if outcome.detail else outcome.text
        if outcome.code == SUCCESSFUL:  # rclpy allows only one severity per line of code
            self.node.get_logger().info(text)
        else:
            self.node.get_logger().warning(text)


def _ended_handle(ended: Outcome | Cancelled, result: Any, handle: Any) -> Any:
    """Set the state of a goal, and return its result."""
    if isinstance(ended, Cancelled):
        handle.canceled()
    elif ended.code == SUCCESSFUL:
        handle.succeed()
    else:
        handle.abort()
    return result
