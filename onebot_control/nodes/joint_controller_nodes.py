"""The nodes of one robot's joint controllers."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rclpy.clock import Clock
from rclpy.node import Node

from onebot_control.joint_controllers import (
    ForwardController,
    GripperCommandController,
    GripperController,
    JointController,
    TrajectoryController,
)
from onebot_control.nodes.commands import CommandLock
from onebot_control.runtime.control_loop import LoopSlot

if TYPE_CHECKING:
    from onebot_control.nodes.controller_node import ControllerNode


def controller_nodes() -> Mapping[type[JointController[Any]], "type[ControllerNode[Any]]"]:
    """Return the class of the ROS interface for each kind of joint controller."""
    # Imported late: actions take 0.1 s, and most robots have only wheels.
    from onebot_control.nodes.forward_commands import ForwardCommands
    from onebot_control.nodes.gripper_actions import GripperActions, GripperCommandActions
    from onebot_control.nodes.joint_trajectories import JointTrajectories

    return {
        TrajectoryController: JointTrajectories,
        ForwardController: ForwardCommands,
        GripperController: GripperActions,
        GripperCommandController: GripperCommandActions,
    }


class JointControllerNodes:
    """Creates the node of each joint controller of a robot, and publishes its state."""

    def __init__(
        self, beside: Node, slot: LoopSlot, lock: CommandLock, clock: Clock | None
    ) -> None:
        """Create the nodes, with their topics, actions and services.

        Args:
            beside: the robot's node; these are in the same namespace.
            slot: slot of the robot.
            lock: lock of the robot; while it is locked, commands are refused.
            clock: clock of the actions' timers; None for each node's own clock.
        """
        self._slot = slot
        robot = slot.robot
        robot.finished.clear()  # goals of earlier nodes, whose clients have gone
        self._arms: dict[str, ControllerNode[Any]] = {}
        kinds = controller_nodes() if robot.joint_controllers else {}
        for name, controller in robot.joint_controllers.items():
            node = Node(name, context=beside.context, namespace=beside.get_namespace())
            self._arms[name] = kinds[type(controller)](
                node,
                controller,
                lambda: slot.robot,
                slot.running,
                lambda: lock.reason if lock.locked else "",
                clock or node.get_clock(),
            )

    @property
    def nodes(self) -> list[Node]:
        """The nodes; the code that starts the loop has to spin them."""
        return [arm.node for arm in self._arms.values()]

    def publish(self, stamp: int) -> None:
        """Publish the states in the control cycle of a ``stamp``, ns, and pass on ended goals."""
        for arm in self._arms.values():
            arm.publish(stamp)
        self.finish()

    def finish(self) -> None:
        """Pass on goals that have ended; call it in the control thread."""
        finished = self._slot.robot.finished
        for name, outcome in finished:
            self._arms[name].finish(outcome)
        finished.clear()
