"""The building blocks of joint controllers' ROS interfaces: a node with parameters, an action.

Everything that changes the robot runs in the control thread, between two cycles.
"""

import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Generic, TypeVar, cast

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.clock import Clock
from rclpy.node import Node
from rclpy.parameter import Parameter

from onebot_control.joint_controllers import JointController, named
from onebot_control.runtime.control_loop import LoopSlot
from onebot_control.trajectories.following import (
    CANCELLED,
    INVALID_GOAL,
    SUCCESSFUL,
    JointFollower,
    Outcome,
)
from onebot_description.errors import OneBotError, first_of
from onebot_description.parameters.values import plain
from onebot_description.ros.message_age import Delivery, SenderClock
from onebot_description.ros.node_parameters import declare, follow_changes, refuse_undeclared
from onebot_description.ros.topic_qos import ANY_PUBLISHER
from onebot_description.ros.wire.interfaces import load_interface
from onebot_description.timing.throttled import Throttled
from onebot_description.timing.wake_detector import boot_time

_IGNORED_EVERY = 1.0  # s between two log messages about ignored messages
_OLD = "it may have been sent before this process was stopped and resumed; send it again"
# Seconds for which a result is kept for its client, as in rclcpp; rclpy's default is 900. It is not
# a whole number of cycles: rcl's timer fires after exactly this time, but a result only expires
# after it. If simulated time stood still at that moment, the timer would be ready forever.
RESULT_KEPT = 10.0000005

Values = Mapping[str, Any]


F = TypeVar("F", bound=JointFollower)
G = TypeVar("G")  # a goal, as the follower takes it


@dataclass(frozen=True)
class ControllerPlace:
    """The environment in which a joint controller creates its interface.

    Attributes:
        node: the node, with the controller's name.
        controller: the controller with the parameters of the files.
        slot: slot of the robot.
        refused: returns why commands are currently rejected; "" if they are not.
        clock: clock of the timers.
        stamp: returns the stamp of the last control cycle, ns.
        publishers: called in each control cycle, to publish the controller's state.
        listeners: called in the control thread with the outcome of a goal of the controller.
    """

    node: Node
    controller: JointController[Any]
    slot: LoopSlot
    refused: Callable[[], str]
    clock: Clock
    stamp: Callable[[], int]
    publishers: list[Callable[[], None]] = field(default_factory=list)
    listeners: list[Callable[[Outcome], None]] = field(default_factory=list)


class ControllerNode(Generic[F]):
    """The node of one joint controller: its parameters, and access to its follower.

    Callbacks run in the thread that spins the node, and only change the robot in the control
    thread.

    Attributes:
        controller: the controller with the current parameters.
        loop: the control loop, which calls everything that changes the robot.
    """

    def __init__(
        self,
        place: ControllerPlace,
        declared: Values | None = None,
        own: Callable[[Values], Values] = dict,
    ) -> None:
        """Configure the follower, and apply changes of the parameters.

        Args:
            place: node, controller and robot.
            declared: current values of the parameters declared on the node; None to declare the
                controller's.
            own: converts values of the declared parameters to the controller's; raises OneBotError
                if they are wrong.
        """
        self.node, self.place, self.loop = place.node, place, place.slot.running
        self.controller: JointController[F] = place.controller
        kind = place.controller.kind.parameters
        if declared is None:
            declared = declare(self.node, kind, fixed=place.controller.values)
        self._values, self._own = dict(declared), own
        self.error = Throttled(lambda text: self.node.get_logger().error(text), _IGNORED_EVERY)
        with named(place.controller.name):
            self.controller = self._configured()  # has the command line's parameters
        place.slot.robot.configure_controller(self.controller)
        refuse_undeclared(self.node, kind)
        follow_changes(self.node, self._configured, self._apply)

    @property
    def follower(self) -> F:
        """The follower of the robot in its current world."""
        return cast(F, self.place.slot.robot.followers[self.controller.name])

    def subscribe(
        self, kind: Any, topic: str, prepare: Callable[[Any], Callable[[], None] | None]
    ) -> None:
        """Subscribe to commands; those sent before the process was resumed are ignored.

        Args:
            kind: type of the messages.
            topic: name of the topic.
            prepare: called with each message; returns a function for the control thread.
        """
        sender = SenderClock()

        def receive(message: Any, info: Mapping[str, Any]) -> None:
            sent = boot_time() - sender.age(Delivery.from_info(info), time.time_ns()).maximum
            if (act := prepare(message)) is not None:
                self.loop.post(lambda: act_on(sent, act))

        def act_on(sent: float, act: Callable[[], None]) -> None:
            if self.loop.predates_wake(sent):
                self.error("old", f"{topic} is ignored: {_OLD}")
            else:
                act()

        self.node.create_subscription(kind, topic, receive, ANY_PUBLISHER)

    def _apply(self, parameters: Sequence[Parameter]) -> None:
        self._values.update(self._changed(parameters))
        self.controller = controller = self._configured()
        slot = self.place.slot
        if fault := slot.fault(lambda: slot.robot.configure_controller(controller)):
            self.node.get_logger().error(f"parameters not applied: {fault}")

    def _changed(self, parameters: Sequence[Parameter]) -> dict[str, Any]:
        return {p.name: plain(p.value) for p in parameters if p.name in self._values}

    def _configured(self, parameters: Sequence[Parameter] = ()) -> JointController[F]:
        """Return the controller with the current values, and ``parameters`` set."""
        values = self._own({**self._values, **self._changed(parameters)})
        return JointController(self.controller.kind, self.controller.name, values)


@dataclass(frozen=True)
class GoalFunctions(Generic[G]):
    """The functions of an action for its goals.

    Attributes:
        goal: converts a request to a goal for the follower; may take long.
        problems: returns why a goal is rejected, one line per reason; may take long.
        follow: follows a goal with its handle; returns the outcome of the preempted goal.
            Runs in the control thread.
        fill_feedback: fills a feedback message. Runs in the control thread.
        fill_result: fills the result of a goal that has just ended. Runs in the control thread.
        accepted: called with an accepted goal, before it is followed.
    """

    goal: Callable[[Any], G]
    problems: Callable[[G], list[str]]
    follow: Callable[[G, Any], Outcome | None]
    fill_feedback: Callable[[Any], None]
    fill_result: Callable[[Any, Outcome], None]
    accepted: Callable[[G], object] = id


class DeferredAction(ActionServer):
    """An action whose goals are executed by the control loop."""

    def notify_execute(self, goal_handle: Any, execute_callback: Any) -> None:
        """Do nothing: the follower is already executing the goal."""

    def finish(self, goal_handle: Any, end: Callable[[Any], Any]) -> None:
        """End a goal soon: ``end`` sets its state and returns its result."""
        super().notify_execute(goal_handle, end)


class GoalAction(Generic[G]):
    """An action of a controller: its goals move the joints.

    ``start`` and ``finish`` run in the control thread.
    """

    def __init__(
        self, host: ControllerNode[Any], kind: str, name: str, functions: GoalFunctions[G]
    ) -> None:
        """Offer the action.

        Args:
            host: the controller.
            kind: type of the action.
            name: name of the action.
            functions: its functions for goals.
        """
        self._host, self._functions = host, functions
        self._type = load_interface(kind)
        self._ended: deque[tuple[Outcome, Any]] = deque()  # each with its result
        host.follower.active = None  # the goal of an earlier node has no client left
        self._action = DeferredAction(
            host.node,
            self._type,
            name,
            lambda goal: self._type.Result(),
            goal_callback=self._on_goal,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
            result_timeout=RESULT_KEPT,
        )
        rate = host.controller.config.action_monitor_rate
        host.place.listeners.append(self.finish)
        host.node.create_timer(1.0 / rate, self._monitor, clock=host.place.clock)

    def finish(self, outcome: Outcome) -> None:
        """Queue the result of a goal that has ended, for its client."""
        result = self._type.Result()
        self._functions.fill_result(result, outcome)
        self._ended.append((outcome, result))

    def start(self, follower: JointFollower, goal: G, handle: Any) -> None:
        """Follow a goal that was checked for ``follower``.

        Raises:
            OneBotError: it can no longer be followed.
        """
        if follower is not self._host.follower:
            raise OneBotError("the robot was just reset, or its description changed")
        if refused := self._host.place.refused():
            raise OneBotError(refused)
        if preempted := self._functions.follow(goal, handle):
            self.finish(preempted)

    # Goals are checked in the node's thread: many points take longer than a control cycle.
    def refusal(self, goal: G) -> str:
        """Return why a goal cannot currently be followed; "" if it can."""
        return self._host.place.refused() or first_of([*self._functions.problems(goal)])

    def _cancel(self, handle: Any) -> None:
        """Cancel a goal, unless it has just ended: then its client receives that result."""
        if self._host.follower.active is handle:
            self._host.follower.cancel()
            self.finish(Outcome(handle, CANCELLED, ""))

    def _feedback(self) -> Any:
        feedback = self._type.Feedback()
        self._functions.fill_feedback(feedback)
        return feedback

    def _on_goal(self, request: Any) -> GoalResponse:
        follower, goal = self._host.follower, self._functions.goal(request)
        if fault := _OLD if self._host.loop.just_woke else self.refusal(goal):
            self._host.node.get_logger().error(f"goal rejected: {fault}")
            return GoalResponse.REJECT
        self._accepted = follower, goal
        return GoalResponse.ACCEPT

    def _on_accepted(self, handle: Any) -> None:
        follower, goal = self._accepted  # rclpy calls this immediately after ``_on_goal``
        self._functions.accepted(goal)
        handle.execute()
        if fault := self._host.place.slot.fault(lambda: self.start(follower, goal, handle)):
            self.finish(Outcome(handle, INVALID_GOAL, fault))

    def _on_cancel(self, handle: Any) -> CancelResponse:
        """Cancel a goal, and always accept.

        When a client cancels all goals, rclpy skips the goal after a rejected one. A goal that has
        just ended keeps its own result.
        """
        if fault := self._host.place.slot.fault(lambda: self._cancel(handle)):
            self._host.node.get_logger().error(f"goal not stopped: {fault}")
        return CancelResponse.ACCEPT

    def _monitor(self) -> None:
        """Send feedback, and the results of goals that have ended."""
        # Wait, as the client's next goal would be rejected right after the process was resumed.
        while self._ended and not self._host.loop.just_woke:
            self._end(*self._ended.popleft())
        if (handle := self._host.follower.active) is not None:
            with suppress(OneBotError):  # the loop has just ended
                handle.publish_feedback(self._host.loop.call(self._feedback))

    def _end(self, ended: Outcome, result: Any) -> None:
        if ended.code != CANCELLED:
            self._log(ended)
        if ended.goal is not None:
            self._action.finish(ended.goal, partial(_ended_handle, ended, result))

    def _log(self, outcome: Outcome) -> None:
        text = f"{outcome.text}: {outcome.detail}" if outcome.detail else outcome.text
        if outcome.code == SUCCESSFUL:  # rclpy allows only one severity per line of code
            self._host.node.get_logger().info(text)
        else:
            self._host.node.get_logger().warning(text)


def _ended_handle(ended: Outcome, result: Any, handle: Any) -> Any:
    """Set the state of a goal, and return its result."""
    if ended.code == CANCELLED:
        handle.canceled()
    elif ended.code == SUCCESSFUL:
        handle.succeed()
    else:
        handle.abort()
    return result
