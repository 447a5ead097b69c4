"""The ROS interfaces of gripper controllers: the action ~/gripper_cmd of one controller."""

from collections.abc import Callable
from typing import Any, NamedTuple

from sensor_msgs.msg import JointState

from onebot_control.nodes.controller_node import (
    Cancelled,
    ControllerNode,
    ControllerPlace,
    GoalAction,
    GoalFunctions,
)
from onebot_control.trajectories.following import Outcome
from onebot_control.trajectories.gripping import GripperFollower, GripperGoal
from onebot_description.ros.wire.messages import time_message


class GripperAction(NamedTuple):
    """A type of the action, with its ways to write a goal and the measured state of the joint."""

    kind: str
    goal: Callable[[Any], GripperGoal]  # converts a request
    fill_state: Callable[[Any, JointState], None]  # fills a feedback or a result


def _parallel_goal(request: Any) -> GripperGoal:
    command = request.command
    efforts, velocities = [*command.effort, 0.0], [*command.velocity, 0.0]
    return GripperGoal(tuple(command.position), efforts[0], velocities[0])


def _fill_parallel(message: Any, state: JointState) -> None:
    message.state = state


def _command_goal(request: Any) -> GripperGoal:
    return GripperGoal((request.command.position,), request.command.max_effort)


def _fill_command(message: Any, state: JointState) -> None:
    [message.position], [message.effort] = state.position, state.effort


PARALLEL_GRIPPER = GripperAction(
    "control_msgs/action/ParallelGripperCommand", _parallel_goal, _fill_parallel
)
"""As parallel_gripper_action_controller has it."""

GRIPPER_COMMAND = GripperAction("control_msgs/action/GripperCommand", _command_goal, _fill_command)
"""As gripper_controllers has it."""


class GripperActions:
    """The ROS interface of a controller that moves a gripper's joint: ~/gripper_cmd."""

    def __init__(self, place: ControllerPlace, action: GripperAction) -> None:
        """Offer the action, and declare parameters."""
        self._host, self._fill_state = ControllerNode[GripperFollower](place), action.fill_state
        functions = GoalFunctions(
            action.goal, self._problems, self._follow, self._fill, self._fill_result
        )
        GoalAction(self._host, action.kind, "~/gripper_cmd", functions)

    def _problems(self, goal: GripperGoal) -> list[str]:
        return self._host.follower.goal_problems(goal)

    def _follow(self, goal: GripperGoal, handle: Any) -> Outcome | None:
        return self._host.follower.start(goal, handle)

    def _fill_result(self, result: Any, ended: Outcome | Cancelled) -> None:
        self._fill(result)

    def _fill(self, message: Any) -> None:
        """Fill a feedback or a result: the measured state, rad and Nm, or m and N, and flags."""
        host = self._host
        follower, name = host.follower, host.controller.name
        positions, velocities, efforts = host.place.slot.robot.states(name)
        state = JointState(
            name=list(follower.names), position=positions, velocity=velocities, effort=efforts
        )
        state.header.stamp = time_message(host.place.stamp())
        self._fill_state(message, state)
        if hasattr(message, "stalled"):  # ParallelGripperCommand's feedback has the state only
            message.stalled, message.reached_goal = follower.stalled, follower.reached
