"""The nodes of one robot's joint controllers."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from rclpy.clock import Clock
from rclpy.node import Node

from onebot_control.nodes.commands import CommandLock
from onebot_control.runtime.control_loop import LoopSlot
from onebot_control.trajectories.following import JointFollower, TrajectoryFollower
from onebot_control.trajectories.forwarding import PositionForwarder
from onebot_control.trajectories.gripping import GripperCommandFollower, GripperFollower


def controller_interfaces() -> Mapping[type[JointFollower], Callable[[Any], object]]:
    """Return the constructor of the ROS interface, from a ``ControllerPlace``, by follower type."""
    # Imported late: actions take 0.1 s, and most robots only have wheels.
    from onebot_control.nodes.forward_commands import ForwardCommands
    from onebot_control.nodes.gripper_actions import GripperActions
    from onebot_control.nodes.joint_trajectories import JointTrajectories

    return {
        TrajectoryFollower: JointTrajectories,
        PositionForwarder: ForwardCommands,
        GripperFollower: partial(GripperActions, kind="ParallelGripperCommand"),
        GripperCommandFollower: partial(GripperActions, kind="GripperCommand"),
    }


class JointControllerNodes:
    """Creates the node of each joint controller of a robot, and publishes its state.

    Attributes:
        nodes: the nodes, to be spun by the code that starts the loop.
    """

    def __init__(
        self, beside: Node, slot: LoopSlot, lock: CommandLock, clock: Clock | None
    ) -> None:
        """Create the nodes, with their topics, actions and services.

        Args:
            beside: the robot's node, with the same namespace.
            slot: slot of the robot.
            lock: lock of the robot; while it is locked, commands are rejected.
            clock: clock of the actions' timers; None for each node's own clock.
        """
        self._slot, self._stamp = slot, 0
        self.nodes: list[Node] = []
        self._places: dict[str, Any] = {}  # ControllerPlaces, by controller
        robot = slot.robot
        robot.finished.clear()  # goals of earlier nodes have no clients left
        if not robot.joint_controllers:
            return
        from onebot_control.nodes.controller_node import ControllerPlace

        kinds = controller_interfaces()
        for name, controller in robot.joint_controllers.items():
            node = Node(name, context=beside.context, namespace=beside.get_namespace())
            place = self._places[name] = ControllerPlace(
                node=node,
                controller=controller,
                slot=slot,
                refused=lambda: lock.reason if lock.locked else "",
                clock=clock or node.get_clock(),
                stamp=lambda: self._stamp,
            )
            kinds[controller.kind](place)
            self.nodes.append(node)

    def publish(self, stamp: int) -> None:
        """Publish the states in the control cycle at ``stamp``, ns, and pass on ended goals."""
        self._stamp = stamp
        for place in self._places.values():
            for publish in place.publishers:
                publish()
        self.finish()

    def finish(self) -> None:
        """Pass on goals that have ended; call it in the control thread."""
        finished = self._slot.robot.finished
        for name, outcome in finished:
            for listen in self._places[name].listeners:
                listen(outcome)
        finished.clear()
