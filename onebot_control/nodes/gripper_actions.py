"""parallel_gripper_action_controller's ROS interface: the action of one controller."""

from collections.abc import Sequence
from typing import Any

from sensor_msgs.msg import JointState

from onebot_control.nodes.controller_node import Cancelled, GoalNode
from onebot_control.trajectories.following import Outcome
from onebot_control.trajectories.gripping import GripperFollower
from onebot_description.ros.wire.messages import time_message


class GripperActions(GoalNode[GripperFollower, Sequence[float]]):
    """The ROS interface of a controller that moves a gripper's joint: the action ~/gripper_cmd."""

    action = "control_msgs/action/ParallelGripperCommand", "~/gripper_cmd"

    def _goal(self, request: Any) -> Sequence[float]:
        return tuple(request.command.position)

    def _problems(self, goal: Sequence[float]) -> list[str]:
        return self._arm.problems(goal)

    def _follow(self, goal: Sequence[float], handle: Any) -> Outcome | None:
        return self._arm.start(goal[0], handle)

    def _feedback(self) -> Any:
        return self._type.Feedback(state=self._state())

    def _result(self, ended: Outcome | Cancelled) -> Any:
        arm = self._arm
        return self._type.Result(state=self._state(), stalled=arm.stalled, reached_goal=arm.reached)

    def _state(self) -> JointState:
        """Return the measured state of the joint, in rad and Nm, or m and N."""
        positions, velocities, efforts = self._robot().states(self._controller.name)
        state = JointState(
            name=list(self._arm.names), position=positions, velocity=velocities, effort=efforts
        )
        state.header.stamp = time_message(self._stamp)
        return state
