"""The ROS interfaces of gripper controllers: the action ~/gripper_cmd of one controller."""

from typing import Any

from sensor_msgs.msg import JointState

from onebot_control.nodes.controller_node import (
    ControllerNode,
    ControllerPlace,
    GoalAction,
    GoalFunctions,
)
from onebot_control.trajectories.following import Outcome
from onebot_control.trajectories.gripping import GripperFollower, GripperGoal
from onebot_description.ros.wire.messages import time_message


def _goal(request: Any) -> GripperGoal:
    """Return the goal in a request of either type."""
    command = request.command
    if hasattr(command, "max_effort"):  # GripperCommand's
        return GripperGoal((command.position,), command.max_effort)
    efforts, velocities = [*command.effort, 0.0], [*command.velocity, 0.0]
    return GripperGoal(tuple(command.position), efforts[0], velocities[0])


class GripperActions:
    """The ROS interface of a controller that moves a gripper's joint: ~/gripper_cmd."""

    def __init__(self, place: ControllerPlace, kind: str) -> None:
        """Offer the action of a ``kind``, and declare parameters."""
        self._host = ControllerNode[GripperFollower](place)
        functions = GoalFunctions(
            _goal, self._problems, self._follow, self._fill, lambda result, _: self._fill(result)
        )
        GoalAction(self._host, f"control_msgs/action/{kind}", "~/gripper_cmd", functions)

    def _problems(self, goal: GripperGoal) -> list[str]:
        return self._host.follower.goal_problems(goal)

    def _follow(self, goal: GripperGoal, handle: Any) -> Outcome | None:
        return self._host.follower.start(goal, handle)

    def _fill(self, message: Any) -> None:
        """Fill a feedback or a result: the measured state, rad and Nm, or m and N, and flags."""
        host = self._host
        follower, name = host.follower, host.controller.name
        positions, velocities, efforts = host.place.slot.robot.states(name)
        state = JointState(
            name=list(follower.names), position=positions, velocity=velocities, effort=efforts
        )
        state.header.stamp = time_message(host.place.stamp())
        if hasattr(message, "state"):  # ParallelGripperCommand's
            message.state = state
        else:
            [message.position], [message.effort] = positions, efforts
        if hasattr(message, "stalled"):  # the feedback of ParallelGripperCommand only has the state
            message.stalled, message.reached_goal = follower.stalled, follower.reached
