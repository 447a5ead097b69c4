"""The ROS interfaces of gripper controllers: the action of one controller."""

from typing import Any

from sensor_msgs.msg import JointState

from onebot_control.nodes.controller_node import Cancelled, GoalNode
from onebot_control.trajectories.following import Outcome
from onebot_control.trajectories.gripping import GripperFollower, GripperGoal
from onebot_description.ros.wire.messages import time_message


class GripperActions(GoalNode[GripperFollower, GripperGoal]):
    """parallel_gripper_action_controller's action ~/gripper_cmd, which moves a gripper's joint."""

    action = "control_msgs/action/ParallelGripperCommand", "~/gripper_cmd"

    def _goal(self, request: Any) -> GripperGoal:
        command = request.command
        efforts, velocities = [*command.effort, 0.0], [*command.velocity, 0.0]
        return GripperGoal(tuple(command.position), efforts[0], velocities[0])

    def _problems(self, goal: GripperGoal) -> list[str]:
        return self._arm.goal_problems(goal)

    def _follow(self, goal: GripperGoal, handle: Any) -> Outcome | None:
        return self._arm.start(goal, handle)

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


class GripperCommandActions(GripperActions):
    """The same action as gripper_controllers has it."""

    action = "control_msgs/action/GripperCommand", "~/gripper_cmd"

    def _goal(self, request: Any) -> GripperGoal:
        return GripperGoal((request.command.position,), request.command.max_effort)

    def _feedback(self) -> Any:
        return self._filled(self._type.Feedback())

    def _result(self, ended: Outcome | Cancelled) -> Any:
        return self._filled(self._type.Result())

    def _filled(self, message: Any) -> Any:
        """Fill the fields that feedback and result have in common."""
        arm = self._arm
        [message.position], _, [message.effort] = self._robot().states(self._controller.name)
        message.stalled, message.reached_goal = arm.stalled, arm.reached
        return message
