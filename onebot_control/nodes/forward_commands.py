"""forward_command_controller's ROS interface: the topic of one controller."""

from collections.abc import Sequence
from typing import Any

from std_msgs.msg import Float64MultiArray

from onebot_control.nodes.controller_node import ControllerNode
from onebot_control.trajectories.forwarding import PositionForwarder
from onebot_description.errors import first_of
from onebot_description.ros.topic_qos import ANY_PUBLISHER


class ForwardCommands(ControllerNode[PositionForwarder]):
    """The ROS interface of a controller that forwards positions to joints: ~/commands."""

    def __init__(self, *arguments: Any) -> None:
        """Subscribe to the topic, and declare parameters; see ``ControllerNode``."""
        super().__init__(*arguments)
        self.node.create_subscription(
            Float64MultiArray, "~/commands", self._on_commands, ANY_PUBLISHER
        )

    def _on_commands(self, message: Float64MultiArray) -> None:
        arm, positions = self._arm, list(message.data)
        if problems := arm.problems(positions):
            self._error("refused", f"~/commands is ignored: {first_of(problems)}")
        else:
            self._loop.post(lambda: self._command(arm, positions))

    def _command(self, arm: PositionForwarder, positions: Sequence[float]) -> None:
        """Command checked positions; runs in the control thread."""
        if refused := self._refused():
            self._error("locked", f"~/commands is ignored: {refused}")
        else:
            arm.command(positions)
